// A program that is linked as the controller cannot include the ground truth's message. That
// message is in another package, with its own include root.
#include "messages/slot.h"
#ifdef FORBIDDEN
#include "tachless_truth/plant_truth_t.hpp"
#endif
