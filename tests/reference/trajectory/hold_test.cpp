#include "reference/trajectory/hold.h"

#include "tests/reference/trajectory/derivatives.h"

namespace tachless::reference::trajectory {
namespace {

TEST(Hold, StaysWhereItIsAtRestThroughSnap) {
  const Vector position = Vector::LinSpaced(3, -1, 1);
  const Hold hold{position};
  for (const double t : {0.0, 1e-3, 100.0}) {
    EXPECT_EQ(hold.at(t).q_ref, position);
    expect_at_rest(hold.at(t), 0);
  }
}

}  // namespace
}  // namespace tachless::reference::trajectory
