// The emergency stop, while others hold every lock of palpated: those of admission, session, log,
// streams, and all others.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>

#include "palpate/v1/device.grpc.pb.h"
#include "tests/support/own_locks.h"
#include "tests/support/patience.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

TEST(StopLocks, TheStopIsTakenWhileEveryLockIsHeld) {
  const test::TemporaryFolder folder;
  const std::string socket = folder.path() / "palpated.sock";
  testing::ServedSession served(socket);
  served.server().Reserve();
  served.data().Load("builtin:sphere:16");
  served.server().Start();
  const auto stub = v1::DeviceService::NewStub(
      grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials()));
  grpc::ClientContext first, stopping;
  const v1::StopForcesRequest stop;
  v1::GetDeviceResponse device;
  v1::StopForcesResponse stopped;
  ASSERT_TRUE(stub->GetDevice(&first, {}, &device).ok());
  std::atomic<bool> is_answered = false;
  // Takes the commands in the servo's place, which does not run.
  ForceSwitch& commands = served.data().servo().forces();
  ASSERT_EQ(commands.Take(), ForceCommand::kNone);
  bool is_taken = false, waits_afterwards = false, is_answered_early = true;
  {
    // No EXPECT in here: GoogleTest's own lock is held, too.
    const test::AllOwnLocksHeld all;
    stub->async()->StopForces(&stopping, &stop, &stopped,
                              [&](const grpc::Status&) { is_answered = true; });
    is_taken = test::Eventually([&] { return commands.Take() == ForceCommand::kStop; });
    waits_afterwards = test::Eventually([&] { return test::AllOwnLocksHeld::waiting() > 0; });
    is_answered_early = is_answered;
  }
  EXPECT_TRUE(is_taken);
  EXPECT_TRUE(waits_afterwards);  // else the locks were not held
  EXPECT_FALSE(is_answered_early);
  EXPECT_TRUE(test::Eventually([&] { return is_answered.load(); }));
}

}  // namespace
}  // namespace palpate
