#pragma once

#include "controller/law/kelly_flexible.h"
#include "controller/law/kelly_regulation.h"
#include "controller/law/loria_ortega_flexible.h"
#include "controller/law/loria_ortega_rigid.h"
#include "controller/law/slotine_li.h"
#include "controller/law/slotine_li_flexible.h"
#include "controller/law/wen_bayard.h"

/// Every law there is, as a list of types. Includes all their headers: for the registry and for
/// tests; others ask the registry.
namespace tachless::controller {

template <class... L>
struct LawList {};

/// To add a law: its header above and its name here; its page in docs/laws, its test.
using Laws = LawList<law::LoriaOrtegaRigid,     //
                     law::LoriaOrtegaFlexible,  //
                     law::KellyRegulation,      //
                     law::KellyFlexible,        //
                     law::WenBayard,            //
                     law::SlotineLi,            //
                     law::SlotineLiFlexible>;

}  // namespace tachless::controller
