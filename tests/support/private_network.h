#pragma once

#include <gtest/gtest.h>

#include "base/this_process.h"

/// A test program that includes this header runs in its own network namespace from its first test
/// on. The namespace has a loopback interface and a multicast route; its traffic meets no other
/// traffic.
class PrivateNetwork : public testing::Environment {
 public:
  void SetUp() override { tachless::base::enter_private_network(); }
};

inline testing::Environment* const private_network =
    testing::AddGlobalTestEnvironment(new PrivateNetwork);
