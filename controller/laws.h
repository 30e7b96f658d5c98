#pragma once

#include <string_view>
#include <type_traits>

#include "controller/law/flexible_motor.h"
#include "controller/law/flexible_position.h"
#include "controller/law/loria_ortega_adaptive.h"
#include "controller/law/loria_ortega_bounded.h"
#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_integral.h"
#include "controller/law/loria_ortega_matrix.h"
#include "controller/law/loria_ortega_rigid.h"
#include "controller/law/loria_ortega_scheduled.h"
#include "controller/law/rivals/berghuis_nijmeijer.h"
#include "controller/law/rivals/computed_torque.h"
#include "controller/law/rivals/difference_of_error.h"
#include "controller/law/rivals/kalman_velocity.h"
#include "controller/law/rivals/kelly_flexible.h"
#include "controller/law/rivals/kelly_regulation.h"
#include "controller/law/rivals/linear_adrc.h"
#include "controller/law/rivals/motor_pd_feedforward.h"
#include "controller/law/rivals/nicosia_tomei.h"
#include "controller/law/rivals/numerical_difference.h"
#include "controller/law/rivals/pd_gravity.h"
#include "controller/law/rivals/robust_differentiator.h"
#include "controller/law/rivals/slotine_li.h"
#include "controller/law/rivals/slotine_li_flexible.h"
#include "controller/law/rivals/wen_bayard.h"
#include "controller/law/rivals/zhang_dawson.h"

/// The list of all laws. To add a law, write a header in law/ or law/rivals/ with a class that has
/// a `name`. Then add its `#include` and its line here. The registry and the tests use this list.
namespace tachless::controller {

template <class... L>
struct LawList {};

/// The laws in the order of their names, one per line.
// clang-format off
using Laws = LawList<
    law::BerghuisNijmeijer,
    law::ComputedTorque,
    law::DifferenceOfError,
    law::FlexibleMotor,
    law::FlexiblePosition,
    law::KalmanVelocity,
    law::KellyFlexible,
    law::KellyRegulation,
    law::LinearAdrc,
    law::LoriaOrtegaAdaptive,
    law::LoriaOrtegaBounded,
    law::LoriaOrtegaFlexible,
    law::LoriaOrtegaIntegral,
    law::LoriaOrtegaMatrix,
    law::LoriaOrtegaRigid,
    law::LoriaOrtegaScheduled,
    law::MotorPdFeedforward,
    law::NicosiaTomei,
    law::NumericalDifference,
    law::PdGravity,
    law::RobustDifferentiator,
    law::SlotineLi,
    law::SlotineLiFlexible,
    law::WenBayard,
    law::ZhangDawson>;
// clang-format on

/// Calls `action(std::type_identity<L>())` for the law of that name.
/// @return whether there is such a law
template <class F>
bool with_law(std::string_view name, const F& action) {
  return [&]<class... L>(LawList<L...> /*laws*/) {
    return ((name == L::name && (action(std::type_identity<L>()), true)) || ...);
  }(Laws());
}

}  // namespace tachless::controller
