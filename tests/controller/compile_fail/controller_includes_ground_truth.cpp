// A program that is linked as the controller cannot include the ground truth's message. That
// message is in another package, with its own include root.
#include "controller/law/loria_ortega_rigid.h"
#include "messages/wire.h"
#ifdef FORBIDDEN
#include "tachless_truth/plant_truth_t.hpp"
#endif

using namespace tachless;

std::string_view channel_of(const controller::law::LoriaOrtegaRigid& /*law*/) {
  return controller::law::LoriaOrtegaRigid::Measurement::suffix;
}
