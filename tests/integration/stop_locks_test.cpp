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
  {
    const test::AllOwnLocksHeld all;
    // Another call shows that the locks are held.
    stub->async()->GetDevice(&reading, &get, &device, count);
    EXPECT_TRUE(test::Eventually([&] { return test::AllOwnLocksHeld::waiting() > 0; }));
    stub->async()->StopForces(&stopping, &stop, &stopped, count);
    EXPECT_TRUE(test::Eventually([&] { return commands.Take() == ForceCommand::kStop; }));
    EXPECT_EQ(answers, 0);
  }
  EXPECT_TRUE(test::Eventually([&] { return answers == 2; }));
}

}  // namespace
}  // namespace palpate
