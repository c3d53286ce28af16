// The one excuse for a test that fails: a busy machine.
#pragma once

namespace palpate::test {

// Marks an assertion that a busy machine alone can fail, about a latency, a rate or a count:
//   EXPECT_LT(p99_ms, 5.0) << test::kBusyMachine;
// If every failed assertion of a program carries the mark, tests/run.sh runs it again. Never mark
// an assertion about a force, a role, a topology or a copy: a slow machine does not change those.
// (One exception: a force that did not come because the emulated bus stood still, see ExcuseSince.)
// Better than a mark that is always there is one that follows a measurement of the machine: see
// DeviceRig::ExcuseSince.
inline constexpr char kBusyMachine[] = "[a busy machine may explain this]";

}  // namespace palpate::test
