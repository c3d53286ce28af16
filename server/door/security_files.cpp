#include "server/door/security_files.h"
#include "server/log/log.h"

#include <fmt/core.h>
#include <sys/stat.h>

#include <chrono>
#include <exception>
#include <memory>
#include <string>
#include <vector>

namespace palpate {
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
