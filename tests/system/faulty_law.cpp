// A law with a fault (fault.h), for stopping_test.cpp. It has none while a prediction asks it.

#include <string_view>

#include "controller/law/loria_ortega_rigid.h"
#include "controller/program.h"
#include "tests/system/fault.h"

using namespace tachless;

namespace {

class FaultyLaw : public controller::law::LoriaOrtegaRigid {
 public:
  static constexpr std::string_view name = "faulty_law";
  using LoriaOrtegaRigid::LoriaOrtegaRigid;

  [[nodiscard]] controller::law::Step<Memory> step(
      const Memory& memory, const Measurement& measurement,
      const messages::ReferencePoint& reference) const {
    system_test::fault_of("step");
    auto result = LoriaOrtegaRigid::step(memory, measurement, reference);
    const std::string what = system_test::setting("FAULT");
    if (++steps_ < 100) return result;
    if (what == "torques seven") result.command.tau = Vector::Zero(7);
    if (what == "signals one") result.signals.num = 1;
    return result;
  }

 private:
  mutable int steps_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]) == "--serve") unsetenv("FAULT");
  }
  return run_controller<FaultyLaw>(argc, argv);
}
