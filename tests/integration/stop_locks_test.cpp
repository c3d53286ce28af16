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
  grpc::ClientContext first, reading, stopping;
  const v1::GetDeviceRequest get;
  const v1::StopForcesRequest stop;
  v1::GetDeviceResponse device;
  v1::StopForcesResponse stopped;
  ASSERT_TRUE(stub->GetDevice(&first, get, &device).ok());
  std::atomic<int> answers = 0;
  const auto count = [&](const grpc::Status&) { ++answers; };
  // Takes the commands in the servo's place, which does not run.
  ForceSwitch& commands = served.data().servo().forces();
  ASSERT_EQ(commands.Take(), ForceCommand::kNone);
  bool others_wait = false, is_taken = false;
  int answers_meanwhile = 0;
  {
    // No EXPECT in here: GoogleTest's own lock is held, too.
    const test::AllOwnLocksHeld all;
    stub->async()->GetDevice(&reading, &get, &device, count);
    others_wait = test::Eventually([&] { return test::AllOwnLocksHeld::waiting() > 0; });
    stub->async()->StopForces(&stopping, &stop, &stopped, count);
    is_taken = test::Eventually([&] { return commands.Take() == ForceCommand::kStop; });
    answers_meanwhile = answers;
  }
  EXPECT_TRUE(others_wait);  // else the locks were not held
  EXPECT_TRUE(is_taken);
  EXPECT_EQ(answers_meanwhile, 0);
  EXPECT_TRUE(test::Eventually([&] { return answers == 2; }));
}

}  // namespace
}  // namespace palpate
