// Addresses, status codes, conversions and events of a volume that both ends of the wire share.
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "common/wire/address.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "common/wire/volume_message.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

TEST(HostPortTest, ParsesNamesAndAddresses) {
  EXPECT_EQ(ParseHostPort("127.0.0.1:7400").host, "127.0.0.1");
  EXPECT_EQ(ParseHostPort("localhost:65535").port, 65535);
  const HostPort ipv6 = ParseHostPort("[::1]:7400");
  EXPECT_EQ(ipv6.host, "::1");
  EXPECT_EQ(ipv6.port, 7400);
}

TEST(HostPortTest, WritesWhatItParsed) {
  for (const char* text : {"127.0.0.1:7400", "[::1]:7400", "[2001:db8::5]:1", "haptics-1:80"}) {
    EXPECT_EQ(ParseHostPort(text).ToString(), text);
  }
}

TEST(HostPortTest, RefusesEverythingElse) {
  for (const char* text : {"",
                           ":",
                           "localhost",
                           "localhost:",
                           ":7400",
                           "localhost:0",
                           "localhost:65536",
                           "localhost:-1",
                           "localhost:+1",
                           "localhost:7400x",
                           "localhost: 7400",
                           "::1:7400",
                           "[::1]",
                           "[::1",
                           "[localhost]:7400",
                           "[]:7400",
                           "[fe80::1%eth0]:7400",
                           "a b:7400",
                           "http://host:7400",
                           "-host:1",
                           "unix:/tmp/x:1",
                           "host/../x:1",
                           "host\n:1"}) {
    EXPECT_EQ(Refusal([&] { ParseHostPort(text); }), ErrorKind::kInvalidArgument) << text;
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
    char name[] = "/tmp/palpate-wire-XXXXXX";
    folder_ = mkdtemp(name);
  }
  ~DefaultSocketPathTest() override { std::filesystem::remove_all(folder_); }

  std::string folder_;
  const std::string absent_ = "/nonexistent/palpate";
};

TEST_F(DefaultSocketPathTest, EnvironmentComesFirst) {
  setenv("PALPATE_SOCKET", "/somewhere/else.sock", 1);
  EXPECT_EQ(DefaultSocketPath(folder_), "/somewhere/else.sock");
  setenv("PALPATE_SOCKET", "", 1);
  EXPECT_EQ(DefaultSocketPath(folder_), folder_ + "/palpated.sock");
}

TEST_F(DefaultSocketPathTest, SystemFolderComesBeforeTheUsers) {
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

TEST_F(DefaultSocketPathTest, FallsBackToAFolderOfTheUserInTmp) {
  EXPECT_EQ(DefaultSocketPath(absent_),
            "/tmp/palpate-" + std::to_string(getuid()) + "/palpated.sock");
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

TEST(StatusTest, OtherExceptionsAreInternal) {
  EXPECT_EQ(ToStatus(std::runtime_error("x")).error_code(), grpc::StatusCode::INTERNAL);
}

TEST(StatusTest, OtherCodesGoToTheNearestKind) {
  EXPECT_EQ(FromStatus({grpc::StatusCode::DEADLINE_EXCEEDED, ""}).kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(FromStatus({grpc::StatusCode::UNIMPLEMENTED, ""}).kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(FromStatus({grpc::StatusCode::OUT_OF_RANGE, ""}).kind(), ErrorKind::kInvalidArgument);
  EXPECT_EQ(FromStatus({grpc::StatusCode::DATA_LOSS, ""}).kind(), ErrorKind::kInternal);
}

TEST(ConvertTest, NumbersComeBackUnchanged) {
  const Vec3 vector(0.1, -2e-300, 3e300);
  EXPECT_EQ(FromProto(ToProto(vector)), vector);
  const Eigen::Quaterniond rotation(0.1, 0.2, 0.3, 0.4);
  EXPECT_EQ(FromProto(ToProto(rotation)).coeffs(), rotation.coeffs());
  AffineMap map;
  map.linear << 1, 2, 3, 4, 5, 6, 7, 8, 10;
  map.translation = vector;
  EXPECT_EQ(FromProto(ToProto(map)).linear, map.linear);
  EXPECT_EQ(FromProto(ToProto(map)).translation, vector);
}

TEST(ConvertTest, LinearPartIsRowMajor) {
  AffineMap map;
  map.linear(0, 2) = 7.0;
  EXPECT_EQ(ToProto(map).linear(2), 7.0);
}

TEST(ConvertTest, IncompleteMapIsRefused) {
  v1::AffineMap message = ToProto(AffineMap());
  message.mutable_linear()->RemoveLast();
  EXPECT_EQ(Refusal([&] { FromProto(message); }), ErrorKind::kInvalidArgument);
}

VolumeMessage ThereAndBack(const VolumeEvent& event) {
  const std::string bytes = ToProto(VolumeMessage{42, event}).SerializeAsString();
  v1::StreamVolumeResponse message;
  EXPECT_TRUE(message.ParseFromString(bytes));
  VolumeMessage back = FromProto(std::move(message));
  EXPECT_EQ(back.number, 42u);
  EXPECT_EQ(back.event.index(), event.index());
  return back;
}

AffineMap Map() {
  AffineMap map;
  map.linear << 1, 2, 3, 4, 5, 6, 7, 8, 10;
  map.translation = Vec3(-1, 0.5, 1e-9);
  return map;
}

TEST(VolumeMessage, EveryEventComesBackAsItWas) {
  const VolumeMessage a = ThereAndBack(VolumeLattice{.source = "x.nrrd",
                                                     .size = Vec3i(1, 20, 300),
                                                     .spacing_mm = Vec3(0.1, 2, 3),
                                                     .X_WI = Map(),
                                                     .value_min = -1024,
                                                     .value_max = 3071,
                                                     .unit = "HU",
                                                     .loaded_revision = 7});
  const auto& lattice = std::get<VolumeLattice>(a.event);
  EXPECT_EQ(lattice.source, "x.nrrd");
  EXPECT_EQ(lattice.size, Vec3i(1, 20, 300));
  EXPECT_EQ(lattice.spacing_mm, Vec3(0.1, 2, 3));
  EXPECT_EQ(lattice.X_WI.linear, Map().linear);
  EXPECT_EQ(lattice.X_WI.translation, Map().translation);
  EXPECT_EQ(lattice.value_min, -1024);
  EXPECT_EQ(lattice.value_max, 3071);
  EXPECT_EQ(lattice.unit, "HU");
  EXPECT_EQ(lattice.loaded_revision, 7u);

  const VolumeMessage b = ThereAndBack(VolumePlacement{Map(), 11});
  EXPECT_EQ(std::get<VolumePlacement>(b.event).X_DI.linear, Map().linear);
  EXPECT_EQ(std::get<VolumePlacement>(b.event).settings_revision, 11u);

  const std::string bytes("\0\xff zstd", 7);
  const VolumeMessage c = ThereAndBack(VolumeOverview{Vec3i(4, 5, 6), 1ull << 40, bytes});
  EXPECT_EQ(std::get<VolumeOverview>(c.event).size, Vec3i(4, 5, 6));
  EXPECT_EQ(std::get<VolumeOverview>(c.event).first_block, 1ull << 40);
  EXPECT_EQ(std::get<VolumeOverview>(c.event).zstd_values, bytes);

  const VolumeMessage d = ThereAndBack(VolumeBricks{{0, 1, 1ull << 50}, bytes, 99});
  EXPECT_EQ(std::get<VolumeBricks>(d.event).numbers,
            (std::vector<std::uint64_t>{0, 1, 1ull << 50}));
  EXPECT_EQ(std::get<VolumeBricks>(d.event).zstd_values, bytes);
  EXPECT_EQ(std::get<VolumeBricks>(d.event).bricks_left, 99u);

  const VolumeMessage e = ThereAndBack(VolumeComplete{{~0ull, 5}, {~0ull - 1, 3}});
  EXPECT_EQ(std::get<VolumeComplete>(e.event).revision, (VolumeRevision{~0ull, 5}));
  EXPECT_EQ(std::get<VolumeComplete>(e.event).content_hash, (ContentHash{~0ull - 1, 3}));
}

TEST(VolumeMessage, WhatIsNoEventIsRefused) {
  v1::StreamVolumeResponse empty, large, bent;
  large.mutable_lattice()->set_size_y(1u << 31);
  bent.mutable_placement()->mutable_device_from_index()->add_linear(1.0);
  for (const v1::StreamVolumeResponse& bad : {empty, large, bent}) {
    EXPECT_EQ(Refusal([&] { FromProto(bad); }), ErrorKind::kInvalidArgument);
  }
}

}  // namespace
}  // namespace palpate
