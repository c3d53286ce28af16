// Copies of the volume over a real gRPC server on a Unix socket, while it is
// edited.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"
#include "common/wire/volume_message.h"
#include "palpate/v1/volume.grpc.pb.h"
#include "tests/support/excuse.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::DifferentVoxels;
using testing::EditableSession;

using Call = grpc::ClientReaderWriter<v1::StreamVolumeRequest, v1::StreamVolumeResponse>;

constexpr auto kPatience = 60s;

double ResidentMiB() {
  std::ifstream file("/proc/self/statm");
  long pages = 0, resident = 0;
  file >> pages >> resident;
  return static_cast<double>(resident) * 4096.0 / (1 << 20);
}

class VolumeStreamTest : public ::testing::Test {
 protected:
  void SetUp() override {
    server_.Reserve();
    data_.Load("builtin:gyroid:64");
    server_.Start();
  }

  std::string socket() const { return folder_.path() / "palpated.sock"; }
  // A connection of its own, not one that gRPC shares between channels.
  std::shared_ptr<grpc::Channel> Channel() const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return grpc::CreateCustomChannel("unix:" + socket(), grpc::InsecureChannelCredentials(),
                                     arguments);
  }

  // Reads until the mirror is complete at the newest revision.
  bool CatchUp(client::VolumeReader& reader, const client::VolumeMirror& mirror) const {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < deadline) {
      if (mirror.is_complete() && mirror.resume()->volume_revision == data_.volume()->revision()) {
        return true;
      }
      reader.Next(100ms);
    }
    return false;
  }

  test::TemporaryFolder folder_;
  mutable testing::ServedSession served_{socket()};
  EditableSession& data_ = served_.data();
  RpcServer& server_ = served_.server();
  std::mt19937 random_{3};
};

TEST_F(VolumeStreamTest, ACopyIsEqualAfterTenThousandEditsAndManyReconnects) {
  client::VolumeMirror mirror;
  const auto channel = Channel();
  auto reader = std::make_unique<client::VolumeReader>(channel, mirror);
  ASSERT_TRUE(CatchUp(*reader, mirror));
  EXPECT_TRUE(mirror.TakeChanges().all);
  std::atomic<bool> done{false}, waits{false};
  std::atomic<int> completes{0};
  std::thread editor([&] {
    for (int n = 0; n < 10000; ++n) {
      const int before = completes;
      data_.RandomEdit(random_, 12);
      if (n % 5 == 0) std::this_thread::sleep_for(1ms);
      if (n % 800 != 799) continue;
      // A copy is to be whole now and then, also where this machine is slow: without
      // reconnects, after which it begins anew.
      waits = true;
      test::Eventually([&] { return completes > before; });
      waits = false;
    }
    done = true;
  });
  int reconnects = 0, messages = 0;
  while (!done) {
    const client::VolumeReader::Event event = reader->Next(10ms);
    completes += event == client::VolumeReader::Event::kComplete;
    if (waits || event == client::VolumeReader::Event::kTimeout || ++messages % 7 != 0) continue;
    // In the midst of a revision, as a rule.
    reader = std::make_unique<client::VolumeReader>(channel, mirror);
    ++reconnects;
  }
  editor.join();
  ASSERT_TRUE(CatchUp(*reader, mirror));
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
  EXPECT_EQ(mirror.resume()->volume_revision, 10001u);
  // Every copy after the first was resumed.
  EXPECT_FALSE(mirror.TakeChanges().all);
  EXPECT_GT(reconnects, 10);
  EXPECT_GT(completes, 10);
  EXPECT_EQ(reader->losses(), 0u);
}

TEST_F(VolumeStreamTest, SeveralViewersOfEditsLoadsAndMoves) {
  std::atomic<bool> done{false};
  std::vector<std::thread> viewers;
  std::atomic<int> equal{0};
  for (int n = 0; n < 6; ++n) {
    viewers.emplace_back([&, n] {
      client::VolumeMirror mirror;
      client::VolumeReader reader(Channel(), mirror, {.max_unacknowledged = n == 0 ? 64u : 1u + n});
      while (!done) {
        reader.Next(10ms);
        if (n == 1) std::this_thread::sleep_for(5ms);
      }
      if (!CatchUp(reader, mirror)) return;
      equal += DifferentVoxels(mirror, *data_.volume()) == 0;
    });
  }
  for (int n = 0; n < 1500; ++n) {
    data_.RandomEdit(random_, 20);
    if (n % 400 == 399) data_.Load(n % 800 < 400 ? "builtin:sphere:48" : "builtin:bumps:56");
    if (n % 3 == 0) {
      data_.session().Move([n](const VolumeState& state) {
        Registration moved = state.registration;
        moved.X_DW.translation.x() = n;
        return moved;
      });
    }
    std::this_thread::sleep_for(1ms);
  }
  done = true;
  for (std::thread& viewer : viewers) viewer.join();
  EXPECT_EQ(equal, 6);
}

// Seconds without reading: 5, or 60 with PALPATE_TORTURE.
TEST_F(VolumeStreamTest, AViewerThatReadsNothingCostsNoMemory) {
  const auto pause = std::getenv("PALPATE_TORTURE") ? 60s : 5s;
  const auto channel = Channel();
  const auto stub = v1::VolumeService::NewStub(channel);
  grpc::ClientContext context;
  const std::unique_ptr<Call> call = stub->StreamVolume(&context);
  v1::StreamVolumeRequest start;
  start.mutable_start()->set_max_unacknowledged(64);
  ASSERT_TRUE(call->Write(start));
  std::this_thread::sleep_for(500ms);
  const double before_mib = ResidentMiB();
  std::vector<std::weak_ptr<const VolumeSnapshot>> old;
  const auto deadline = std::chrono::steady_clock::now() + pause;
  std::uint64_t bytes_edited = 0;
  while (std::chrono::steady_clock::now() < deadline) {
    bytes_edited += 32 << 10;
    const std::weak_ptr<const VolumeSnapshot> edited = data_.RandomEdit(random_, 32);
    // A weak_ptr keeps the place of its snapshot: the test would count its own.
    if (old.size() < 5000) old.push_back(edited);
  }
  // Old volumes that somebody still holds: the newest, and at most what a message
  // is being made of.
  const auto held = [&] {
    return std::count_if(old.begin(), old.end(), [](const auto& v) { return !v.expired(); });
  };
  // The thread that frees them may be pausing.
  EXPECT_TRUE(test::Eventually([&] { return held() <= 2; })) << held();
  EXPECT_GT(old.size(), 100u) << test::kBusyMachine;
  const double more_mib = ResidentMiB() - before_mib;
  std::printf("%zu MiB edited, %.1f MiB more held\n", std::size_t{bytes_edited} >> 20, more_mib);
#ifndef PALPATE_SANITIZED  // which keeps what was freed for a while
  EXPECT_LT(more_mib, 40.0);
#endif

  // And then it reads, with what the transport kept for it first.
  client::VolumeMirror mirror;
  v1::StreamVolumeResponse response;
  std::uint64_t messages = 0;
  while (!mirror.is_complete() || mirror.resume()->volume_revision != data_.volume()->revision()) {
    ASSERT_TRUE(call->Read(&response));
    ++messages;
    v1::StreamVolumeRequest acknowledge;
    acknowledge.mutable_acknowledgement()->set_message_number(response.message_number());
    mirror.Apply(FromProto(std::move(response)).event);
    ASSERT_TRUE(call->Write(acknowledge));
  }
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
  // A window, and the 12 messages of a copy or two, whatever was edited meanwhile.
  EXPECT_LE(messages, 64u + 2 * 12u);
  context.TryCancel();
  call->Finish();
}

TEST_F(VolumeStreamTest, AViewerThatIsKilledHarmsNobody) {
  data_.Load("builtin:gyroid:128");
  client::VolumeMirror mirror;
  client::VolumeReader reader(Channel(), mirror);
  for (int n = 0; n < 5; ++n) {
    const std::string file = folder_.path() / "copy.nrrd";
    test::Process viewer({test::kPalpate, "--socket", socket(), "download", file});
    if (n > 0) viewer.WaitFor("%");
    viewer.Signal(SIGKILL);
    EXPECT_EQ(viewer.Wait().exit_code, -SIGKILL);
    EXPECT_FALSE(std::filesystem::exists(file));
    data_.RandomEdit(random_);
    EXPECT_TRUE(CatchUp(reader, mirror));
  }
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
}

TEST_F(VolumeStreamTest, BadRequestsEndTheStreamWithAReason) {
  const auto channel = Channel();
  const auto stub = v1::VolumeService::NewStub(channel);
  v1::StreamVolumeRequest good, acknowledge, wide, yet_to_come;
  good.mutable_start();
  acknowledge.mutable_acknowledgement()->set_message_number(1);
  wide.mutable_start()->set_max_unacknowledged(65);
  client::VolumeMirror mirror;
  {
    client::VolumeReader reader(channel, mirror);
    ASSERT_TRUE(CatchUp(reader, mirror));
  }
  VolumeRevision future = *mirror.resume();
  ++future.volume_revision;
  *yet_to_come.mutable_start()->mutable_resume_from() = ToProto(future);
  const auto status_of = [&](const std::vector<v1::StreamVolumeRequest>& requests) {
    grpc::ClientContext context;
    const std::unique_ptr<Call> call = stub->StreamVolume(&context);
    for (const auto& request : requests) call->Write(request);
    if (requests.empty()) call->WritesDone();
    v1::StreamVolumeResponse response;
    while (call->Read(&response)) {
    }
    return call->Finish();
  };
  for (const auto& bad : std::vector<std::vector<v1::StreamVolumeRequest>>{
           {}, {acknowledge}, {{}}, {wide}, {yet_to_come}, {good, good}, {good, {}}}) {
    const grpc::Status status = status_of(bad);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << bad.size();
    EXPECT_FALSE(status.error_message().empty());
  }
}

TEST_F(VolumeStreamTest, ClosingTheClientsSideEndsTheStream) {
  const auto channel = Channel();
  const auto stub = v1::VolumeService::NewStub(channel);
  grpc::ClientContext context;
  const std::unique_ptr<Call> call = stub->StreamVolume(&context);
  v1::StreamVolumeRequest start;
  start.mutable_start();
  call->Write(start);
  call->WritesDone();
  v1::StreamVolumeResponse response;
  while (call->Read(&response)) {
  }
  EXPECT_TRUE(call->Finish().ok());
}

TEST_F(VolumeStreamTest, ARevisionThatTheDaemonDoesNotHaveIsMendedByAFreshCopy) {
  client::VolumeMirror mirror;
  {
    client::VolumeReader reader(Channel(), mirror);
    ASSERT_TRUE(CatchUp(reader, mirror));
  }
  // As if the daemon had gone back.
  VolumeComplete future{*mirror.resume(), data_.volume()->bricks().content_hash()};
  future.revision.volume_revision += 5;
  mirror.Apply(future);
  mirror.TakeChanges();
  client::VolumeReader reader(Channel(), mirror);
  ASSERT_TRUE(CatchUp(reader, mirror));
  EXPECT_TRUE(mirror.TakeChanges().all);
  EXPECT_EQ(reader.losses(), 1u);
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
}

TEST_F(VolumeStreamTest, StoppingTheServerEndsStreamsThatReadAndThatDoNot) {
  const auto channel = Channel();
  const auto stub = v1::VolumeService::NewStub(channel);
  v1::StreamVolumeRequest start;
  start.mutable_start();
  grpc::ClientContext idle_context;
  const std::unique_ptr<Call> idle = stub->StreamVolume(&idle_context);
  idle->Write(start);
  client::VolumeMirror mirror;
  client::VolumeReader reader(Channel(), mirror);
  ASSERT_TRUE(CatchUp(reader, mirror));
  std::thread stop([&] { server_.Stop(); });
  while (reader.Next(100ms) != client::VolumeReader::Event::kLost) {
  }
  EXPECT_EQ(reader.last_loss()->kind(), ErrorKind::kUnavailable);
  stop.join();
  v1::StreamVolumeResponse response;
  while (idle->Read(&response)) {
  }
  EXPECT_EQ(idle->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  // What was copied stays, and the reader keeps trying.
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
  while (reader.losses_in_a_row() < 3) reader.Next(100ms);
}

TEST(VolumeStreamOfADaemon, ACopySurvivesTheDaemon) {
  const test::TemporaryFolder folder;
  const std::string socket = folder.path() / "palpated.sock";
  const auto start = [&](const std::string& volume) {
    auto daemon = std::make_unique<test::Process>(
        std::vector<std::string>{test::kPalpated, "--volume", volume, "--socket", socket}, false,
        120s);
    EXPECT_TRUE(daemon->WaitFor("ready on"));
    return daemon;
  };
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 500);
  const auto channel =
      grpc::CreateCustomChannel("unix:" + socket, grpc::InsecureChannelCredentials(), arguments);
  client::VolumeMirror mirror;
  client::VolumeReader reader(channel, mirror, {.longest_pause = 500ms});
  const auto read_until_complete = [&] {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < deadline) {
      if (reader.Next(100ms) == client::VolumeReader::Event::kComplete) return true;
    }
    return false;
  };
  auto daemon = start("builtin:sphere:32");
  ASSERT_TRUE(read_until_complete());
  const VolumeRevision first = *mirror.resume();
  daemon->Signal(SIGKILL);
  daemon->Wait();
  daemon = start("builtin:gyroid:40");
  ASSERT_TRUE(read_until_complete());
  EXPECT_NE(mirror.resume()->daemon_id, first.daemon_id);
  EXPECT_EQ(mirror.lattice()->source, "builtin:gyroid:40");
  EXPECT_GE(reader.losses(), 1u);
}

}  // namespace
}  // namespace palpate
