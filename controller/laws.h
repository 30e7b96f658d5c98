#pragma once

#include <string_view>
#include <type_traits>

#include "controller/law/berghuis_nijmeijer.h"
#include "controller/law/computed_torque.h"
#include "controller/law/difference_of_error.h"
#include "controller/law/kalman_velocity.h"
#include "controller/law/kelly_flexible.h"
#include "controller/law/kelly_regulation.h"
#include "controller/law/lanari_wen.h"
#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_integral.h"
#include "controller/law/loria_ortega_matrix.h"
#include "controller/law/loria_ortega_rigid.h"
#include "controller/law/loria_ortega_scheduled.h"
#include "controller/law/nicosia_tomei.h"
#include "controller/law/numerical_difference.h"
#include "controller/law/pd_gravity.h"
#include "controller/law/robust_differentiator.h"
#include "controller/law/slotine_li.h"
#include "controller/law/slotine_li_flexible.h"
#include "controller/law/wen_bayard.h"
#include "controller/law/zhang_dawson.h"

/// Every law there is, as a list of types. Includes all their headers: for the registry and for
/// tests; others ask the registry.
namespace tachless::controller {

template <class... L>
struct LawList {};

/// To add a law: its header above and its name here; its page in docs/laws, its test.
using Laws = LawList<law::LoriaOrtegaRigid,      //
                     law::LoriaOrtegaFlexible,   //
                     law::LoriaOrtegaIntegral,   //
                     law::LoriaOrtegaMatrix,     //
                     law::LoriaOrtegaScheduled,  //
                     law::KellyRegulation,       //
                     law::KellyFlexible,         //
                     law::WenBayard,             //
                     law::SlotineLi,             //
                     law::SlotineLiFlexible,     //
                     law::BerghuisNijmeijer,     //
                     law::NicosiaTomei,          //
                     law::ZhangDawson,           //
                     law::LanariWen,             //
                     law::NumericalDifference,   //
                     law::DifferenceOfError,     //
                     law::KalmanVelocity,        //
                     law::RobustDifferentiator,  //
                     law::ComputedTorque,        //
                     law::PdGravity>;

/// action(std::type_identity<L>()) for the law of that name. @return whether there is one
template <class F>
bool with_law(std::string_view name, const F& action) {
  return [&]<class... L>(LawList<L...> /*laws*/) {
    return ((name == L::name && (action(std::type_identity<L>()), true)) || ...);
  }(Laws());
}

}  // namespace tachless::controller
