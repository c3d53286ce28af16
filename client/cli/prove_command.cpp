#include "client/cli/commands.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/utsname.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "client/cli/output.h"
#include "client/cli/prove.h"
#include "client/program/interrupt.h"
#include "common/error/text.h"
#include "common/files/new_file.h"

namespace palpate::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kRateHz = 1000.0;
constexpr std::uint32_t kBatch = 16;
constexpr std::chrono::milliseconds kPoll(50);

void ThrowIfInterrupted() {
  if (Interrupt::IsRaised()) throw Error(ErrorKind::kCancelled, "cancelled");
}

class PersonAtTerminal final : public Person {
 public:
  void Say(const std::string& step, const std::string& text) override {
    std::string line;
    AppendLine(line, step == last_step_ ? "" : step, text);
    last_step_ = step;
    WriteOutput(line);
  }
  void WaitForEnter() override { Line(); }
  bool AskYesNo(const std::string& question) override {
    while (true) {
      WriteOutput(fmt::format("{:<10}{} [y/n] ", "", question));
      const std::string answer = Line();
      if (isatty(STDIN_FILENO) == 0) WriteOutput(answer + "\n");
      if (answer == "y" || answer == "yes") return true;
      if (answer == "n" || answer == "no") return false;
    }
  }

 private:
  // A signal may come to another thread, so the read must not wait for long.
  std::string Line() {
    // A second Enter must not start the next push.
    if (isatty(STDIN_FILENO) == 1) tcflush(STDIN_FILENO, TCIFLUSH);
    while (typed_.find('\n') == std::string::npos) {
      ThrowIfInterrupted();
      pollfd input{STDIN_FILENO, POLLIN, 0};
      if (poll(&input, 1, static_cast<int>(kPoll.count())) <= 0) continue;
      char buffer[256];
      const ssize_t count = read(STDIN_FILENO, buffer, sizeof(buffer));
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) throw Error(ErrorKind::kCancelled, "nobody answers: the input has ended");
      typed_.append(buffer, static_cast<std::size_t>(count));
    }
    const std::size_t end = typed_.find('\n');
    const std::string line = typed_.substr(0, end);
    typed_.erase(0, end + 1);
    return line;
  }

  std::string typed_;
  std::string last_step_;
};

class ProvedCalls final : public ProvedDaemon {
 public:
  explicit ProvedCalls(client::Calls& palpated) : palpated_(palpated) {}

  client::DaemonInfo GetDevice() override { return palpated_.GetDevice(); }
  std::vector<client::ListedDevice> ListDevices() override { return palpated_.ListDevices(); }
  void EnableForces(const std::string& kind) override { palpated_.EnableForces(kind); }
  void DisableForces() override { palpated_.DisableForces(); }
  std::uint64_t StopForces() override { return palpated_.StopForces().applied_tick; }
  std::uint64_t PushHand(const Vec3& force_n, double seconds) override {
    return palpated_.PushHand(force_n, seconds);
  }
  void Follow() override { reader_.emplace(palpated_.ReadPoses(kRateHz, kBatch)); }
  std::vector<client::Pose> Read(double seconds) override {
    std::vector<client::Pose> poses;
    const auto end = Clock::now() + std::chrono::duration<double>(seconds);
    while (Clock::now() < end) {
      ThrowIfInterrupted();
      const std::optional<client::PoseBatch> batch = reader_->Next(kPoll);
      if (batch) poses.insert(poses.end(), batch->poses.begin(), batch->poses.end());
    }
    return poses;
  }

 private:
  client::Calls& palpated_;
  std::optional<client::PoseReader> reader_;
};

// The system's name for people, such as "Debian GNU/Linux 12 (bookworm)".
std::string SystemName() {
  constexpr std::string_view kKey = "PRETTY_NAME=";
  std::ifstream file("/etc/os-release");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with(kKey)) continue;
    std::erase(line, '"');
    return line.substr(kKey.size());
  }
  return "";
}

ProofVersions VersionsHere() {
  utsname system{};
  uname(&system);
  return {PALPATE_VERSION, system.release, system.machine, SystemName()};
}

// In the working directory.
fs::path FolderFor(const std::string& kind) {
  std::string name;
  for (const char c : kind) name += (std::isalnum(static_cast<unsigned char>(c)) != 0) ? c : '-';
  return fmt::format("palpate-proof-{}-{:%Y%m%d-%H%M%S}", name, fmt::localtime(std::time(nullptr)));
}

void WriteFile(const fs::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text << std::flush;
  if (!file) throw CannotWrite(path, errno);
}

void WriteFolder(const fs::path& folder, const Proof& proof) {
  std::error_code error;
  if (!fs::create_directory(folder, error)) {
    throw CannotWrite(folder, error ? error.value() : EEXIST);
  }
  WriteFile(folder / "proof.json", ToText(ToJson(proof, VersionsHere()), 2));
  WriteFile(folder / "readings.csv", TableOf(proof.readings));
}

void Run(client::Calls& palpated, const std::string& forces_of, const std::string& out) {
  if (std::error_code error; !out.empty() && fs::exists(out, error)) {
    throw Error(ErrorKind::kConflict, out + " exists: name a new folder");
  }
  const Interrupt interrupt;
  ProvedCalls daemon(palpated);
  PersonAtTerminal person;
  const Proof proof = Prove(daemon, person, forces_of);
  const fs::path folder = out.empty() ? FolderFor(proof.daemon.device.kind) : fs::path(out);
  WriteFolder(folder, proof);
  const std::string next = proof.rehearsal
                               ? "nothing to send after a rehearsal"
                               : "look into it, then send it: see deploy/guides/devices.md";
  WriteOutput(fmt::format("proposed level: {}\nwrote {}: {}\n", NameOf(proof.level),
                          OneLine(folder.string()), next));
  if (proof.refusal) {
    throw Error(proof.refusal->kind(), proof.step + ": " + proof.refusal->what());
  }
}

}  // namespace

void AddProve(arguments::Command& device, Invocation& invocation) {
  struct Values {
    std::string forces;
    std::string out;
  };
  arguments::Command* command = device.add_subcommand(
      "prove",
      "Proves the device, step by step, with a person who holds the stylus: it is found, gives\n"
      "readings, its axes and buttons are right; with --forces, it pushes and stops. Ends at the\n"
      "first thing that is not right, and says what to do. Forces are off at the end. Writes a\n"
      "folder without personal data, to be sent. Exit code 10: something is not right.");
  SetFooter(*command, "Example: palpate device prove --forces falcon");
  const auto values = std::make_shared<Values>();
  command
      ->add_option("--forces", values->forces,
                   "The device's kind, as `info` shows it: its motors are tried, too")
      ->option_text("KIND");
  command
      ->add_option("--out", values->out,
                   "The folder to write; it must not exist\n"
                   "[default: palpate-proof-KIND-DATE-TIME]")
      ->option_text("FOLDER");
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) {
      Run(palpated, values->forces, values->out);
    };
  });
}

}  // namespace palpate::cli
