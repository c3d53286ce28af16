#include "server/door/tls.h"

#include <fmt/chrono.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/log/log.h"

namespace palpate {
namespace {

constexpr unsigned kRefreshSeconds = 1;
constexpr std::chrono::hours kWarnedBeforeEnd{14 * 24};
constexpr std::chrono::hours kBetweenWarnings{24};

std::string ToText(CertificateTime time) {
  return fmt::format("{:%Y-%m-%d %H:%M} UTC",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

void MakePrivateFolder(const std::filesystem::path& folder) {
  struct stat status {};
  const bool made = mkdir(folder.c_str(), 0700) == 0;
  if (!made && errno != EEXIST) {
    throw Error(ErrorKind::kPermissionDenied,
                "cannot make the folder " + folder.string() + ": " + std::strerror(errno));
  }
  if (lstat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode) ||
      status.st_uid != geteuid() || (status.st_mode & 077) != 0) {
    throw Error(ErrorKind::kPermissionDenied,
                folder.string() + " is not a folder of the daemon's user alone: remove it");
  }
}

}  // namespace

TlsFiles::TlsFiles(const TlsOptions& options, const std::filesystem::path& folder)
    : options_(options), folder_(folder), pair_(folder / "pair.pem") {
  MakePrivateFolder(folder_);
  Update();
}

TlsFiles::~TlsFiles() {
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

void TlsFiles::Update() {
  const auto now = std::chrono::system_clock::now();
  const CheckedPair pair = CheckPair(options_.certificate, options_.key, now);
  // One file holds both, so that the key and the certificate always belong together.
  NewFile next(pair_, IfThere::kReplace, 0600);
  next.Write(pair.pem);
  next.TakeName(Durable::kNo);  // made anew at each start
  valid_until_ = pair.valid_until;
  next_warning_ = {};
  LogInfo("TLS with the certificate of {}, valid until {}", pair.subject, ToText(valid_until_));
  WarnBeforeEnd(now);
}

void TlsFiles::WarnBeforeEnd(CertificateTime now) {
  if (valid_until_ - now >= kWarnedBeforeEnd || now < next_warning_) return;
  next_warning_ = now + kBetweenWarnings;
  LogWarning("the certificate {} ends at {}: put a new one in its place",
             options_.certificate.string(), ToText(valid_until_));
}

std::shared_ptr<grpc::ServerCredentials> TlsFiles::MakeCredentials() const {
  const auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      pair_.string(), pair_.string(), kRefreshSeconds);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_BUT_DONT_VERIFY);
  // Uses no metadata processor: for one, gRPC 1.51 would copy all headers of a call, and it aborts
  // at a header that only its load balancers send.
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace palpate
