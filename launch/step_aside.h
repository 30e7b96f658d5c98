#pragma once

namespace launch {

/// From now on this process, and every child it starts, runs only when nobody else wants the
/// processor. Where that is refused, nothing is lost but politeness.
void step_aside();

}  // namespace launch
