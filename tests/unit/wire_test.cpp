// Addresses, status codes, conversions and events of a volume that both ends of the wire share.
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <tuple>
#include <vector>

#include "common/wire/address.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "common/wire/volume_message.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using testing::Refusal;

TEST(HostPortTest, ParsesNamesAndAddressesAndWritesThem) {
  for (const auto& [text, host, port] : std::vector<std::tuple<std::string, std::string, int>>{
           {"127.0.0.1:7400", "127.0.0.1", 7400},
           {"localhost:65535", "localhost", 65535},
           {"[::1]:7400", "::1", 7400},
           {"[2001:db8::5]:1", "2001:db8::5", 1},
           {"haptics-1:80", "haptics-1", 80}}) {
    const HostPort parsed = ParseHostPort(text);
    EXPECT_EQ(parsed.host, host);
    EXPECT_EQ(parsed.port, port) << text;
    EXPECT_EQ(parsed.ToString(), text);
  }
}

TEST(HostPortTest, RefusesEverythingElse) {
  const std::vector<std::vector<const char*>> refused = {
      {"", ":", "localhost", "localhost:", "[::1]", "[::1"},  // no port
      {"localhost:0", "localhost:65536", "localhost:-1", "localhost:+1", "localhost:7400x"},
      {"localhost: 7400", ":7400", "::1:7400", "[localhost]:7400", "[]:7400", "a b:7400"},
      {"[fe80::1%eth0]:7400", "http://host:7400", "-host:1", "unix:/tmp/x:1", "host/../x:1"},
      {"host\n:1"}};
  for (const auto& texts : refused) {
    for (const char* text : texts) {
      EXPECT_EQ(Refusal([&] { ParseHostPort(text); }), ErrorKind::kInvalidArgument) << text;
    }
  }
}

TEST(HostPortTest, TargetNamesTheScheme) {
  EXPECT_EQ(TcpTarget({"unix", 7400}), "dns:///unix:7400");
  EXPECT_EQ(TcpTarget({"::1", 7400}), "ipv6:%5B::1%5D:7400");
}

TEST(UnixTargetTest, MakesThePathAbsolute) {
  EXPECT_EQ(UnixTarget("/run/palpate/palpated.sock"), "unix:/run/palpate/palpated.sock");
  EXPECT_EQ(UnixTarget("a.sock"), "unix:" + (std::filesystem::current_path() / "a.sock").string());
}

TEST(UnixTargetTest, LimitsTheLength) {
  const std::string longest = "/" + std::string(kMaxSocketPathLength - 1, 'x');
  EXPECT_EQ(UnixTarget(longest), "unix:" + longest);
  EXPECT_EQ(Refusal([&] { UnixTarget(longest + "x"); }), ErrorKind::kInvalidArgument);
}

TEST(SocketPaths, TheOthersLieBesideTheUsualOne) {
  const std::string usual = "/run/palpate/palpated.sock";
  EXPECT_EQ(RoleSocketPath(usual, Role::kAdmin), usual);
  EXPECT_EQ(RoleSocketPath(usual, Role::kViewer), "/run/palpate/palpated-viewer.sock");
  EXPECT_EQ(RoleSocketPath("/tmp/or-2", Role::kOperator), "/tmp/or-2-operator");
  EXPECT_EQ(DoorSocketPath(usual, Role::kEditor), "/run/palpate/palpated-door-editor.sock");
  EXPECT_EQ(StopSocketPath(usual), "/run/palpate/palpated-stop.sock");
  EXPECT_EQ(StopSocketPath("/tmp/or-2"), "/tmp/or-2-stop");
}

TEST(SocketPaths, TheStopOfARoleIsBesideItsSocketOrTheUsualOne) {
  const test::TemporaryFolder folder;
  for (const std::string usual : {folder.path() / "a.sock", folder.path() / "b"}) {
    for (const Role role : {Role::kViewer, Role::kEditor, Role::kOperator}) {
      const std::string of_role = RoleSocketPath(usual, role);
      EXPECT_EQ(FindStopSocket(of_role), StopSocketPath(usual));
      std::ofstream(StopSocketPath(of_role)).put('x');
      EXPECT_EQ(FindStopSocket(of_role), StopSocketPath(of_role));
    }
    EXPECT_EQ(FindStopSocket(usual), StopSocketPath(usual));
  }
}

TEST(SocketPaths, TheHighestThatIsThere) {
  const test::TemporaryFolder folder;
  const std::string usual = folder.path() / "palpated.sock";
  EXPECT_EQ(HighestSocketPath(usual), usual);
  for (const Role role : {Role::kViewer, Role::kEditor, Role::kOperator, Role::kAdmin}) {
    const std::string path = RoleSocketPath(usual, role);
    std::ofstream(path).put('x');
    EXPECT_EQ(HighestSocketPath(usual), path);
  }
}

TEST(UnixTargetTest, RefusesWhatGrpcWouldReadDifferently) {
  for (const char* path : {"", "/tmp/a%20b", "/tmp/a?b", "/tmp/a#b", "/tmp/a b", "/tmp/\xc3\xa4"}) {
    EXPECT_EQ(Refusal([&] { UnixTarget(path); }), ErrorKind::kInvalidArgument) << path;
  }
}

class DefaultSocketPathTest : public ::testing::Test {
 protected:
  DefaultSocketPathTest() {
    unsetenv("PALPATE_SOCKET");
    unsetenv("XDG_RUNTIME_DIR");
  }

  const test::TemporaryFolder temporary_;
  const std::string folder_ = temporary_.path();
  const std::string absent_ = "/nonexistent/palpate";
};

TEST_F(DefaultSocketPathTest, EnvironmentComesFirst) {
  setenv("PALPATE_SOCKET", "/somewhere/else.sock", 1);
  EXPECT_EQ(DefaultSocketPath(folder_), "/somewhere/else.sock");
  setenv("PALPATE_SOCKET", "", 1);
  EXPECT_EQ(DefaultSocketPath(folder_), folder_ + "/palpated.sock");
}

TEST_F(DefaultSocketPathTest, SystemFolderComesBeforeTheUsersAndThatInTmp) {
  EXPECT_EQ(DefaultSocketPath(absent_),
            "/tmp/palpate-" + std::to_string(getuid()) + "/palpated.sock");
  setenv("XDG_RUNTIME_DIR", "/run/user/1000", 1);
  EXPECT_EQ(DefaultSocketPath(folder_), folder_ + "/palpated.sock");
  EXPECT_EQ(DefaultSocketPath(absent_), "/run/user/1000/palpate/palpated.sock");
}

TEST_F(DefaultSocketPathTest, ReadOnlySystemFolderCountsWithTheSocketInIt) {
  if (getuid() == 0) {
    GTEST_SKIP() << "root may write every folder";
  }
  setenv("XDG_RUNTIME_DIR", "/run/user/1000", 1);
  chmod(folder_.c_str(), 0500);
  EXPECT_EQ(DefaultSocketPath(folder_), "/run/user/1000/palpate/palpated.sock");
  chmod(folder_.c_str(), 0700);
  std::ofstream(folder_ + "/palpated.sock").put('x');
  chmod(folder_.c_str(), 0500);
  EXPECT_EQ(DefaultSocketPath(folder_), folder_ + "/palpated.sock");
  chmod(folder_.c_str(), 0700);
}

TEST(StatusTest, EveryKindSurvivesTheWire) {
  const struct {
    ErrorKind kind;
    grpc::StatusCode code;
  } kinds[] = {{ErrorKind::kInternal, grpc::StatusCode::INTERNAL},
               {ErrorKind::kInvalidArgument, grpc::StatusCode::INVALID_ARGUMENT},
               {ErrorKind::kNotFound, grpc::StatusCode::NOT_FOUND},
               {ErrorKind::kPermissionDenied, grpc::StatusCode::PERMISSION_DENIED},
               {ErrorKind::kTooLarge, grpc::StatusCode::RESOURCE_EXHAUSTED},
               {ErrorKind::kDiskFull, grpc::StatusCode::RESOURCE_EXHAUSTED},
               {ErrorKind::kConflict, grpc::StatusCode::ABORTED},
               {ErrorKind::kUnavailable, grpc::StatusCode::UNAVAILABLE},
               {ErrorKind::kCancelled, grpc::StatusCode::CANCELLED},
               {ErrorKind::kFailedPrecondition, grpc::StatusCode::FAILED_PRECONDITION}};
  for (const auto& [kind, code] : kinds) {
    const grpc::Status status = ToStatus(Error(kind, "what to do"));
    EXPECT_EQ(status.error_code(), code);
    EXPECT_EQ(status.error_message(), "what to do");
    EXPECT_EQ(FromStatus(status).kind(), kind);
    EXPECT_STREQ(FromStatus(status).what(), "what to do");
  }
}

TEST(StatusTest, OthersGoToTheNearestKind) {
  EXPECT_EQ(ToStatus(std::runtime_error("x")).error_code(), grpc::StatusCode::INTERNAL);
  EXPECT_EQ(FromStatus(ToStatus(std::bad_alloc())).kind(), ErrorKind::kTooLarge);
  EXPECT_EQ(FromStatus({grpc::StatusCode::DEADLINE_EXCEEDED, ""}).kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(FromStatus({grpc::StatusCode::UNIMPLEMENTED, ""}).kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(FromStatus({grpc::StatusCode::OUT_OF_RANGE, ""}).kind(), ErrorKind::kInvalidArgument);
  EXPECT_EQ(FromStatus({grpc::StatusCode::DATA_LOSS, ""}).kind(), ErrorKind::kInternal);
}

AffineMap Map() {
  AffineMap map;
  map.linear << 1, 2, 3, 4, 5, 6, 7, 8, 10;
  map.translation = Vec3(-1, 0.5, 1e-9);
  return map;
}

// Files and paths may hold others. C++ would send them, and nobody could read the message.
TEST(ConvertTest, TextsAreUtf8) {
  const v1::VolumeDescription volume = ToProto(VolumeDescription{
      .source = "M\xfcller \xc3\xa4 \xe2\x82", .warnings = {"\xff"}, .name = "\xed\xa0\x80"});
  EXPECT_EQ(volume.source(), "M?ller \xc3\xa4 ??");
  EXPECT_EQ(volume.warnings(0), "?");
  VolumeLattice lattice;
  lattice.unit = "\xb5m";
  EXPECT_EQ(ToProto(VolumeMessage{1, lattice}).lattice().unit(), "?m");
  EXPECT_EQ(volume.name(), "???");
}

TEST(ConvertTest, AMapHasItsRowsOneAfterTheOther) {
  v1::AffineMap message = ToProto(Map());
  EXPECT_EQ(message.linear(2), 3.0);  // row-major
  message.mutable_linear()->RemoveLast();
  EXPECT_EQ(Refusal([&] { FromProto(message); }), ErrorKind::kInvalidArgument);
}

// No two fields of an event are alike, and none is a default.
TEST(VolumeMessage, EveryEventComesBackAsItWas) {
  const std::string bytes("\0\xff zstd", 7);
  const VolumeEvent events[] = {
      VolumeLattice{.source = "x.nrrd",
                    .size = Vec3i(1, 20, 300),
                    .spacing_mm = Vec3(0.1, 2, 3),
                    .X_WI = Map(),
                    .value_min = -1024,
                    .value_max = 3071,
                    .background = 3072.5,
                    .unit = "HU",
                    .window_level = 700,
                    .window_width = 2600,
                    .loaded_revision = 7,
                    .type = LeafType::kInt16},
      VolumePlacement{Map(), 11, "RAS", true, true},
      VolumeOverview{Vec3i(4, 5, 6), 1ull << 40, bytes},
      VolumeBricks{LeafType::kUint16, {0, 1, 1ull << 50}, bytes, {{{7, 1ull << 40}, -2.5f}}, 99},
      VolumeComplete{{~0ull, 5}, {~0ull - 1, 3}, {4, ~0ull - 2}},
  };
  for (const VolumeEvent& event : events) {
    const std::string sent = ToProto(VolumeMessage{42, event}).SerializeAsString();
    v1::StreamVolumeResponse message;
    ASSERT_TRUE(message.ParseFromString(sent));
    const auto* which = message.GetDescriptor()->oneof_decl(0);
    const auto* field = message.GetReflection()->GetOneofFieldDescriptor(message, which);
    ASSERT_NE(field, nullptr);
    const auto& content = message.GetReflection()->GetMessage(message, field);
    std::vector<const google::protobuf::FieldDescriptor*> told;
    content.GetReflection()->ListFields(content, &told);
    EXPECT_EQ(static_cast<int>(told.size()), content.GetDescriptor()->field_count())
        << field->name();
    const VolumeMessage back = FromProto(std::move(message));
    EXPECT_EQ(back.number, 42u);
    EXPECT_EQ(back.event.index(), event.index());
    EXPECT_EQ(ToProto(back).SerializeAsString(), sent) << field->name();
  }
}

TEST(VolumeMessage, WhatIsNoEventIsRefused) {
  v1::StreamVolumeResponse empty, large, bent, nowhere, untyped, wide;
  large.mutable_lattice()->set_size_y(1u << 31);
  bent.mutable_placement()->mutable_device_from_index()->add_linear(1.0);
  nowhere.mutable_placement();
  untyped.mutable_bricks();
  wide.mutable_bricks()->set_voxel_type(v1::VOXEL_TYPE_INT32);
  for (const v1::StreamVolumeResponse& bad : {empty, large, bent, nowhere, untyped, wide}) {
    EXPECT_EQ(Refusal([&] { FromProto(bad); }), ErrorKind::kInvalidArgument);
  }
}

}  // namespace
}  // namespace palpate
