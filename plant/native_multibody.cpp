#include "plant/multibody.h"
#include "robot/dynamics.h"

namespace tachless::plant {
namespace {

robot::Model without_rotors(robot::Model model) {
  model.rotor_inertia.resize(0);  // `Arm` adds it
  return model;
}

class NativeMultibody final : public Multibody {
 public:
  explicit NativeMultibody(const robot::Model& model) : model_(without_rotors(model)) {}

  Terms evaluate(const Vector& q, const Vector& v) override {
    robot::set_equations_of_motion(model_, q, v, M_, bias_);
    return {M_, bias_};
  }

 private:
  const robot::Model model_;
  Matrix M_;
  Vector bias_;
};

}  // namespace

std::unique_ptr<Multibody> native_multibody(const robot::Model& model) {
  return std::make_unique<NativeMultibody>(model);
}

}  // namespace tachless::plant
