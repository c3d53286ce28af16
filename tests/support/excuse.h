// The one excuse for a test that fails: a busy machine.
#pragma once

namespace palpate::test {

// Marks an assertion that can fail only because a busy machine changes a latency, a rate or a
// count:
//   EXPECT_LT(p99_ms, 5.0) << test::kBusyMachine;
// If every failed assertion of a program has the mark, tests/run.sh runs the program again. Never
// mark an assertion about a force, a role, a topology or a copy: a slow machine does not change
// those. One exception: a force did not come because the emulated bus stood still, see
// DeviceRig::ExcuseSince. A mark that depends on a measurement of the machine, as there, is better
// than a permanent mark.
// DeviceRig::ExcuseSince.
inline constexpr char kBusyMachine[] = "[a busy machine may explain this]";

}  // namespace palpate::test
