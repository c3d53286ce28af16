#include "server/volume/import_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <utility>

#include "common/error/error.h"
#include "common/files/descriptor.h"
#include "server/volume/handover.h"

extern char** environ;

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kLongestLine = 8192;
constexpr std::size_t kMostLines = 64;
constexpr auto kPollInterval = std::chrono::milliseconds(50);
// The importer ends itself at its timeout. If it does not, it is killed this much later.
constexpr auto kTimeoutGrace = std::chrono::seconds(2);
constexpr std::string_view kMessagePrefix = "palpate-import: ";
constexpr std::string_view kWarningPrefix = "warning: ";
// The importer's share of the progress. The rest is for taking over the volume.
constexpr double kImporterShare = 0.9;

struct Pipe {
  Descriptor read;
  Descriptor write;
};

[[noreturn]] void FailInternal(const std::string& what, int error) {
  throw Error(ErrorKind::kInternal, what + ": " + std::strerror(error));
}

Pipe MakePipe() {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) FailInternal("cannot make a pipe", errno);
  Pipe pipe{Descriptor(ends[0]), Descriptor(ends[1])};
  // Only our end is non-blocking: the importer may block, we must not.
  fcntl(pipe.read.get(), F_SETFL, O_NONBLOCK);
  return pipe;
}

std::string Decimal(double value) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

void AddRawArguments(const RawVoxels& raw, std::vector<std::string>* arguments) {
  arguments->push_back("--raw-size=" + std::to_string(raw.size[0]) + "," +
                       std::to_string(raw.size[1]) + "," + std::to_string(raw.size[2]));
  arguments->push_back("--raw-type=" + raw.type);
  arguments->push_back("--raw-offset=" + std::to_string(raw.offset_bytes));
  if (raw.big_endian) arguments->push_back("--raw-big-endian");
}

// The importer's descriptor of the file in memory.
constexpr int kHandoverDescriptor = 3;

std::vector<std::string> Arguments(const ImportRequest& request) {
  std::vector<std::string> arguments = {
      request.import_program.string(),
      "--progress",
      "--to-descriptor=" + std::to_string(kHandoverDescriptor),
      "--max-voxels=" + std::to_string(request.max_voxels),
      "--max-memory-mib=" +
          std::to_string(std::max<std::int64_t>(request.max_memory_bytes >> 20, 1)),
      "--timeout-s=" + std::to_string(std::max<std::int64_t>(request.timeout.count(), 1)),
  };
  if (request.folders) {
    // Also passed if the list of folders is empty: then the importer may read only files beside the
    // source.
    arguments.push_back("--only-below=" + request.source.string());
    for (const auto& folder : *request.folders) {
      arguments.push_back("--only-below=" + folder.string());
    }
  }
  for (const auto& path : request.own_files.paths()) {
    arguments.push_back("--never=" + path.string());
  }
  if (request.spacing_mm) {
    const Vec3& s = *request.spacing_mm;
    arguments.push_back("--spacing-mm=" + Decimal(s.x()) + "," + Decimal(s.y()) + "," +
                        Decimal(s.z()));
  }
  if (request.frame) arguments.push_back("--frame=" + std::to_string(*request.frame));
  if (request.raw) AddRawArguments(*request.raw, &arguments);
  if (!request.grid.empty()) arguments.push_back("--grid=" + request.grid);
  if (!request.component.empty()) arguments.push_back("--component=" + request.component);
  // "--", because a path may start with a dash.
  arguments.insert(arguments.end(), {"--", request.source.string()});
  return arguments;
}

class SpawnSettings {
 public:
  SpawnSettings(int out, int err, int handover) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions_, out, 1);
    posix_spawn_file_actions_adddup2(&actions_, err, 2);
    posix_spawn_file_actions_adddup2(&actions_, handover, kHandoverDescriptor);
    posix_spawnattr_init(&attributes_);
    // The importer does not inherit our signal mask, and does not get the terminal's Ctrl-C: we end
    // it ourselves.
    sigset_t none;
    sigset_t all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    posix_spawnattr_setpgroup(&attributes_, 0);
    posix_spawnattr_setflags(
        &attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;
  const posix_spawn_file_actions_t* actions() const { return &actions_; }
  const posix_spawnattr_t* attributes() const { return &attributes_; }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

// The running importer. The destructor kills and reaps it if it still runs.
class Process {
 public:
  Process(std::vector<std::string> arguments, int out, int err, int handover) {
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    const SpawnSettings settings(out, err, handover);
    const int error = posix_spawn(&pid_, argv[0], settings.actions(), settings.attributes(),
                                  argv.data(), environ);
    if (error != 0) {
      pid_ = -1;
      FailInternal("cannot start " + arguments[0] + " (is Palpate installed completely?)", error);
    }
  }
  ~Process() {
    if (pid_ < 0) return;
    kill(pid_, SIGKILL);
    while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // Returns waitpid's status if the process has ended.
  std::optional<int> Poll() {
    int status = 0;
    if (waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
    pid_ = -1;
    return status;
  }

 private:
  pid_t pid_ = -1;
};

// Splits the text from a pipe into lines of limited length.
class Lines {
 public:
  // False if the pipe has ended.
  bool ReadFrom(const Descriptor& pipe, const std::function<void(std::string_view)>& on_line) {
    std::array<char, 4096> buffer;
    const ssize_t count = read(pipe.get(), buffer.data(), buffer.size());
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    for (ssize_t i = 0; i < count; ++i) {
      if (buffer[i] != '\n') {
        if (line_.size() < kLongestLine) line_ += buffer[i];
        continue;
      }
      on_line(line_);
      line_.clear();
    }
    if (count == 0 && !line_.empty()) on_line(line_);
    return count > 0;
  }

 private:
  std::string line_;
};

// Parses "progress FRACTION STAGE".
void ReportProgress(std::string_view line,
                    const std::function<void(std::string_view, double)>& progress) {
  constexpr std::string_view kWord = "progress ";
  if (!progress || !line.starts_with(kWord)) return;
  line.remove_prefix(kWord.size());
  double fraction = 0.0;
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), fraction);
  if (error != std::errc() || !(fraction >= 0.0 && fraction <= 1.0)) return;
  line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  if (line.starts_with(' ')) line.remove_prefix(1);
  progress(line, fraction * kImporterShare);
}

// Parses "size X Y Z BYTES": the volume's size, and the bytes of a voxel in the file. A stack of
// slices tells growing sizes. A smaller one than before would take back what was claimed.
void ReportSize(std::string_view line, const SizeKnown& on_size, std::uint64_t& told_bytes) {
  constexpr std::string_view kWord = "size";
  if (!on_size || !line.starts_with(kWord)) return;
  line.remove_prefix(kWord.size());
  std::array<int, 4> numbers{};
  for (int& number : numbers) {
    if (!line.starts_with(' ')) return;
    const auto [end, error] = std::from_chars(line.data() + 1, line.data() + line.size(), number);
    if (error != std::errc() || number < 1) return;
    line.remove_prefix(static_cast<std::size_t>(end - line.data()));
  }
  if (!line.empty()) return;
  const auto [x, y, z, bytes] = numbers;
  std::int64_t voxels = 0;
  if (__builtin_mul_overflow(std::int64_t{x} * y, z, &voxels) || voxels > kMostLatticeVoxels) {
    throw Error(ErrorKind::kTooLarge, "the importer names a size that no volume has");
  }
  const LeafType type = bytes == 1   ? LeafType::kUint8
                        : bytes == 2 ? LeafType::kInt16
                                     : LeafType::kFloat;
  const LoadMemory memory = DenseLoadMemory({x, y, z}, type);
  if (memory.Sum() < told_bytes) return;
  told_bytes = memory.Sum();
  on_size({x, y, z}, memory);
}

struct Outcome {
  int status = 0;                     // as of waitpid
  std::vector<std::string> messages;  // without the prefix
  std::vector<std::string> warnings;
};

void AddMessage(std::string_view line, Outcome* outcome) {
  if (!line.starts_with(kMessagePrefix)) return;
  line.remove_prefix(kMessagePrefix.size());
  auto& list = line.starts_with(kWarningPrefix) ? outcome->warnings : outcome->messages;
  if (line.starts_with(kWarningPrefix)) line.remove_prefix(kWarningPrefix.size());
  if (list.size() < kMostLines) list.emplace_back(line);
}

[[noreturn]] void ThrowCancelled(const ImportRequest& request) {
  throw Error(ErrorKind::kCancelled, request.source.string() + ": the import was cancelled");
}

Outcome RunImporter(const ImportRequest& request, int handover,
                    const std::function<void(std::string_view, double)>& progress,
                    const std::function<bool()>& cancelled) {
  Pipe out = MakePipe();
  Pipe err = MakePipe();
  Process process(Arguments(request), out.write.get(), err.write.get(), handover);
  out.write.Close();
  err.write.Close();

  const auto deadline = Clock::now() + request.timeout + kTimeoutGrace;
  Outcome outcome;
  Lines out_lines;
  Lines err_lines;
  std::uint64_t told_bytes = 0;
  const auto on_progress = [&](std::string_view line) {
    ReportProgress(line, progress);
    ReportSize(line, request.on_size, told_bytes);
  };
  const auto on_message = [&](std::string_view line) { AddMessage(line, &outcome); };
  for (;;) {
    // A closed descriptor is -1, which poll ignores.
    std::array<pollfd, 2> fds = {{{out.read.get(), POLLIN, 0}, {err.read.get(), POLLIN, 0}}};
    poll(fds.data(), fds.size(), static_cast<int>(kPollInterval.count()));
    if (fds[0].revents && !out_lines.ReadFrom(out.read, on_progress)) out.read.Close();
    if (fds[1].revents && !err_lines.ReadFrom(err.read, on_message)) err.read.Close();
    if (cancelled && cancelled()) {
      ThrowCancelled(request);
    }
    if (Clock::now() > deadline) {
      throw Error(ErrorKind::kTooLarge, request.source.string() + ": the import took longer than " +
                                            std::to_string(request.timeout.count()) +
                                            " s; crop the volume or raise the limit");
    }
    if (out.read.get() >= 0 || err.read.get() >= 0) continue;
    if (const auto status = process.Poll()) {
      outcome.status = *status;
      return outcome;
    }
  }
}

ErrorKind KindOf(int exit_code) {
  for (const ErrorKind kind :
       {ErrorKind::kInvalidArgument, ErrorKind::kNotFound, ErrorKind::kPermissionDenied,
        ErrorKind::kTooLarge, ErrorKind::kConflict, ErrorKind::kUnavailable, ErrorKind::kCancelled,
        ErrorKind::kDiskFull}) {
    if (ExitCode(kind) == exit_code) return kind;
  }
  return ErrorKind::kInternal;
}

void ThrowUnlessSuccess(const ImportRequest& request, const Outcome& outcome) {
  const std::string source = request.source.string();
  if (WIFSIGNALED(outcome.status)) {
    const int signal = WTERMSIG(outcome.status);
    if (signal == SIGKILL || signal == SIGXCPU || signal == SIGXFSZ) {
      throw Error(ErrorKind::kTooLarge,
                  source + ": the import ran out of memory, time or disk; crop the volume");
    }
    // The importer's own line names the format, unless it crashed too badly to write it.
    throw Error(ErrorKind::kInternal,
                source + ": the reader of this format crashed (" + strsignal(signal) +
                    "); this is a fault of the reader: save the volume in another format");
  }
  const int code = WEXITSTATUS(outcome.status);
  if (code == 0) return;
  throw Error(KindOf(code), outcome.messages.empty()
                                ? source + ": the importer failed with exit code " +
                                      std::to_string(code) + " and said nothing"
                                : outcome.messages.back());
}

}  // namespace

LoadedVolume ImportVolume(const ImportRequest& request,
                          const std::function<void(std::string_view, double)>& progress,
                          const std::function<bool()>& cancelled,
                          std::vector<std::string>* warnings) {
  const Descriptor handover = MakeHandoverFile();
  const Outcome outcome = RunImporter(request, handover.get(), progress, cancelled);
  ThrowUnlessSuccess(request, outcome);
  if (warnings) {
    warnings->insert(warnings->end(), outcome.warnings.begin(), outcome.warnings.end());
  }
  const auto tell = [&](double fraction) {
    if (cancelled && cancelled()) ThrowCancelled(request);
    if (progress) progress("loading", kImporterShare + (1.0 - kImporterShare) * fraction);
  };
  bool is_telling = false;  // during a listener's call; its exceptions name the file themselves
  const auto on_size = [&](const Vec3i& size, const LoadMemory& memory) {
    is_telling = true;
    if (request.on_size) request.on_size(size, memory);
    is_telling = false;
  };
  const auto on_progress = [&](double fraction) {
    is_telling = true;
    tell(fraction);
    is_telling = false;
  };
  try {
    LoadedVolume volume = TakeHandover(
        handover.get(),
        {.max_voxels = request.max_voxels, .on_size = on_size, .progress = on_progress});
    tell(1.0);
    return volume;
  } catch (const Error& error) {
    if (is_telling) throw;
    throw Error(error.kind(), request.source.string() + ": " + error.what());
  } catch (const std::bad_alloc&) {
    throw Error(ErrorKind::kTooLarge,
                request.source.string() + ": there is not enough memory to hold it");
  }
}

}  // namespace palpate
