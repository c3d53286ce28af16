#include "client/view/palpated/local_daemon.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <optional>
#include <vector>

#include "common/error/error.h"
#include "common/files/descriptor.h"
#include "common/files/new_file.h"

namespace palpate::view {
namespace {

// A palpated ends within a second. With a large recording, it first writes that to the disk.
constexpr std::chrono::seconds kEndPatience{10};

std::filesystem::path OwnFolder() {
  std::error_code error;
  return std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
}

// The log's lines are "2026-01-31 12:00:00.123 error another palpated ..."; what ends the daemon is
// printed without time and level.
std::string WithoutPrefix(const std::string& line) {
  if (line.empty() || line.front() < '0' || line.front() > '9') return line;
  std::size_t at = 0;
  for (int space = 0; space < 3; ++space) {
    at = line.find(' ', at);
    if (at == std::string::npos) return line;
    ++at;
  }
  return line.substr(at);
}

}  // namespace

std::filesystem::path FindPalpated(const std::filesystem::path& own_folder,
                                   const std::string& path_variable) {
  const std::filesystem::path beside = FindProgram("palpated", own_folder.string());
  return beside.empty() ? FindProgram("palpated", path_variable) : beside;
}

std::string LastLineOf(const std::filesystem::path& log) {
  std::ifstream in(log);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \t") != std::string::npos) last = line;
  }
  return WithoutPrefix(last);
}

bool IsServed(const std::string& socket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket.size() >= sizeof address.sun_path) return false;
  std::memcpy(address.sun_path, socket.c_str(), socket.size() + 1);
  const Descriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (probe.get() < 0) return false;
  return connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ||
         errno == EAGAIN;
}

LocalDaemon::~LocalDaemon() {
  if (!program_) return;
  if (kept_) {
    program_->Leave();
  } else {
    program_->End(kEndPatience);
  }
}

void LocalDaemon::Start(const std::string& socket, const std::filesystem::path& log_folder,
                        bool fresh) {
  Poll();
  if (program_) return;
  problem_.clear();
  const std::filesystem::path palpated = FindPalpated(OwnFolder(), VariableOf("PATH"));
  if (palpated.empty()) {
    problem_ = "there is no palpated beside palpate-view or in PATH: install palpate-daemon";
    return;
  }
  try {
    if (log_folder.empty()) throw Error(ErrorKind::kUnavailable, "HOME is not set");
    MakeFolders(log_folder);
    log_ = log_folder / "palpated.log";
    const std::string home = VariableOf("HOME");
    const std::string folder = home.empty() ? "/" : home;
    std::vector<std::string> command = {
        palpated, "--volume",      "builtin:bumps", "--device",      "simulated", "--socket",
        socket,   "--load-folder", folder,          "--save-folder", folder};
    if (fresh) command.emplace_back("--fresh");
    program_ = std::make_unique<ChildProgram>(command, log_);
    address_ = "unix:" + socket;
    unsaved_edits_ = 0;
  } catch (const Error& error) {
    problem_ = error.what();
  }
}

bool LocalDaemon::Serves(const std::string& address) const { return runs() && address == address_; }

void LocalDaemon::NoteUnsaved(const std::string& address, std::uint64_t edits) {
  if (Serves(address)) unsaved_edits_ = edits;
}

void LocalDaemon::Poll() {
  const std::optional<int> code = program_ ? program_->Poll() : std::nullopt;
  if (!code) return;
  program_.reset();
  problem_ = "palpated ended";
  // A killed program has not said why: its last line is of something else.
  if (*code < 0) {
    problem_ += ": signal " + std::to_string(-*code) + " killed it";
  } else if (const std::string last = LastLineOf(log_); *code > 0 && !last.empty()) {
    problem_ += ": " + last;
  }
  if (unsaved_edits_ > 0) problem_ += "; edits that were lost: " + std::to_string(unsaved_edits_);
  unsaved_edits_ = 0;
  problem_ += " (" + log_.string() + ")";
}

}  // namespace palpate::view
