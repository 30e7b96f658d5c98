#pragma once

namespace tachless::process {

/// Moves this process, and every child it starts from now on, into a network namespace of its own
/// that has a loopback interface with a multicast route and nothing else: nothing leaks out,
/// nothing interferes. Needs no root where the kernel allows unprivileged user namespaces; the
/// process then is root in its namespace and the user it was outside. Call before any thread
/// starts.
/// @throw std::system_error with the step that failed and what to do
void enter_private_network();

}  // namespace tachless::process
