#include "server/door/security_files.h"

#include <fmt/chrono.h>
#include <fmt/core.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <vector>

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

namespace {

constexpr std::chrono::seconds kBetweenLooks{1};

// A text that changes whenever the file changes.
std::string StampOf(const std::filesystem::path& path) {
  struct stat status {};
  if (path.empty() || stat(path.c_str(), &status) != 0) return "-;";
  return fmt::format("{} {} {}.{} {}.{};", status.st_ino, status.st_size, status.st_mtim.tv_sec,
                     status.st_mtim.tv_nsec, status.st_ctim.tv_sec, status.st_ctim.tv_nsec);
}

}  // namespace

void SecurityFiles::Start(const PolicyOptions& policy, const TlsOptions& pair) {
  pair_ = pair;
  options_ = policy;
  // Taken before the files are read, so that a change during the reading is noticed afterwards.
  stamps_ = Stamps();
  policy_ = std::make_shared<const Policy>(policy);
  access_.SetPolicy(policy_);
  thread_ = std::thread([this] { Run(); });
}

void SecurityFiles::Stop() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::function<void()> SecurityFiles::Prepare(const PolicyOptions& options) {
  const auto policy = std::make_shared<const Policy>(options);
  return [this, options, policy] {
    const std::lock_guard lock(mutex_);
    options_ = options;
    policy_ = policy;
    access_.SetPolicy(policy);
    // Makes the next check read all files again: they may have changed since Prepare.
    stamps_.clear();
    ReadPair();
  };
}

std::string SecurityFiles::Stamps() const {
  return StampOf(options_.tokens) + StampOf(options_.client_ca) + StampOf(pair_.certificate) +
         StampOf(pair_.key);
}

void SecurityFiles::ReadPolicy() {
  std::vector<std::string> problems;
  policy_ = std::make_shared<const Policy>(options_, *policy_, problems);
  access_.SetPolicy(policy_);
  for (const std::string& problem : problems) LogError("{}", problem);
  if (problems.empty()) LogInfo("roles and tokens were read again");
}

void SecurityFiles::ReadPair() {
  if (!tls_) return;
  try {
    tls_->Update();
  } catch (const std::exception& error) {
    LogError("the certificate stays as it was: {}", error.what());
  }
}

void SecurityFiles::Run() {
  std::unique_lock lock(mutex_);
  while (!changed_.wait_for(lock, kBetweenLooks, [this] { return ending_; })) {
    const std::string stamps = Stamps();
    if (stamps != stamps_) {
      stamps_ = stamps;
      ReadPolicy();
      ReadPair();
    }
    if (tls_) tls_->WarnBeforeEnd(std::chrono::system_clock::now());
    lock.unlock();  // a reload and the end do not wait for the calls that end here
    access_.Review();
    lock.lock();
  }
}

}  // namespace palpate
