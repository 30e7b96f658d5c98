#pragma once

namespace tachless::process {

/// From now on this process leaves no core dump, and other processes of its user can neither trace
/// it nor read its memory. Programs that it starts are not concerned.
/// @throw std::system_error when the system refuses
void make_memory_private();

}  // namespace tachless::process
