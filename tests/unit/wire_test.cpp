// Addresses, status codes and conversions that both ends of the wire share.
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>

#include "common/wire/address.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"

namespace palpate {
namespace {

ErrorKind KindThrownBy(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.kind();
  }
  ADD_FAILURE() << "no error";
  return ErrorKind::kInternal;
}

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
    EXPECT_EQ(KindThrownBy([&] {
                try {
                  ParseHostPort(text);
                } catch (const Error& error) {
                  // The text is quoted as it came; callers print it on one line.
                  throw Error(error.kind(), "refused");
                }
              }),
              ErrorKind::kInvalidArgument)
        << text;
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
  EXPECT_EQ(KindThrownBy([&] { UnixTarget(longest + "x"); }), ErrorKind::kInvalidArgument);
}

TEST(UnixTargetTest, RefusesWhatGrpcWouldReadDifferently) {
  for (const char* path : {"", "/tmp/a%20b", "/tmp/a?b", "/tmp/a#b", "/tmp/a b", "/tmp/\xc3\xa4"}) {
    EXPECT_EQ(KindThrownBy([&] { UnixTarget(path); }), ErrorKind::kInvalidArgument) << path;
  }
}

class DefaultSocketPathTest : public testing::Test {
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
  EXPECT_EQ(KindThrownBy([&] { FromProto(message); }), ErrorKind::kInvalidArgument);
}

}  // namespace
}  // namespace palpate
