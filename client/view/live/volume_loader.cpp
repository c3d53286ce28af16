#include "client/view/live/volume_loader.h"

#include <chrono>
#include <filesystem>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

#include "client/download/download_file.h"
#include "client/sdk/words.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

using Outcome = VolumeLoader::Outcome;
using Result = VolumeLoader::Result;

constexpr std::chrono::milliseconds kLoadingPause{100};

bool IsBuiltin(const std::string& source) { return source.starts_with("builtin:"); }

std::string NameOf(const std::string& path) {
  const std::filesystem::path whole(path);
  // A folder's name may end with a slash.
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

// True if palpated cannot use a path that may be right here.
bool IsOfPaths(const Error& error) {
  return error.kind() == ErrorKind::kPermissionDenied || error.kind() == ErrorKind::kNotFound;
}

// Waits while palpated loads its first volume. Returns the edits that are not saved.
std::uint64_t AwaitFirstVolume(client::Calls& palpated, const client::ProgressFunction& progress) {
  for (;;) {
    try {
      return palpated.GetVolume().unsaved_edits;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kLoading) throw;
      if (!progress({.stage = "waiting", .fraction = 0.0, .detail = error.what()})) {
        throw Error(ErrorKind::kCancelled, "nothing was opened");
      }
    }
    std::this_thread::sleep_for(kLoadingPause);
  }
}

Outcome Load(client::Calls& palpated, const std::string& source, bool discard_edits,
             const client::ProgressFunction& progress) {
  const std::uint64_t unsaved = AwaitFirstVolume(palpated, progress);
  if (unsaved > 0 && !discard_edits) {
    return {.result = Result::kUnsaved, .path = source, .unsaved_edits = unsaved};
  }
  LoadFromHere(palpated, source, {.discard_edits = discard_edits}, progress);
  return {.result = Result::kLoaded, .path = source, .text = "opened " + NameOf(source)};
}

Outcome Save(client::Calls& palpated, const std::string& file, SaveWhere where, bool overwrite,
             const client::ProgressFunction& progress) {
  Outcome outcome{.result = Result::kSaved, .path = file, .where = where};
  try {
    const std::uint64_t bytes = SaveVolume(palpated, file, where, overwrite, progress);
    char size[32];
    std::snprintf(size, sizeof size, "%.1f MB", 1e-6 * static_cast<double>(bytes));
    outcome.text = "saved " + file + ", " + size;
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kConflict || overwrite) throw;
    outcome.result = Result::kExists;
    outcome.text = error.what();
  }
  return outcome;
}

}  // namespace

client::LoadResult LoadFromHere(client::Calls& palpated, const std::string& source,
                                const client::LoadOptions& options,
                                const client::ProgressFunction& progress) {
  if (IsBuiltin(source)) return palpated.LoadVolume(source, options, progress);
  if (palpated.shares_clock()) {
    try {
      return palpated.LoadVolume(std::filesystem::absolute(source).string(), options, progress);
    } catch (const Error& error) {
      if (!IsOfPaths(error)) throw;
    }
  }
  return palpated.UploadVolume(source, options, progress);
}

std::uint64_t SaveVolume(client::Calls& palpated, const std::string& file, SaveWhere where,
                         bool overwrite, const client::ProgressFunction& progress) {
  if (where == SaveWhere::kThere) return palpated.SaveVolume(file, overwrite, progress).size_bytes;
  if (palpated.shares_clock()) {
    try {
      // Unlike a copy, this counts as saved.
      return palpated.SaveVolume(std::filesystem::absolute(file).string(), overwrite, progress)
          .size_bytes;
    } catch (const Error& error) {
      if (!IsOfPaths(error)) throw;
    }
  }
  const auto check = [&progress] {
    if (!progress({.stage = "writing", .fraction = 1.0})) {
      throw Error(ErrorKind::kCancelled, "no file was written");
    }
  };
  client::DownloadToFile(palpated, file, overwrite, progress, check);
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(file, error);
  return error ? 0 : bytes;
}

struct VolumeLoader::Task {
  bool opens = false;  // set before the task is shared
  std::mutex mutex;
  Running running;
  bool is_cancelled = false;
  std::optional<Outcome> outcome;

  void Finish(Outcome result) {
    const std::lock_guard lock(mutex);
    outcome = std::move(result);
  }

  // Runs on the thread of the commands.
  void Run(const std::string& path, const std::function<Outcome()>& work) {
    try {
      Finish(work());
    } catch (const Error& error) {
      const bool cancelled = error.kind() == ErrorKind::kCancelled;
      Finish({.result = cancelled ? Result::kCancelled : Result::kFailed,
              .path = path,
              .text = error.what()});
    } catch (const std::exception& error) {
      Finish({.result = Result::kFailed, .path = path, .text = error.what()});
    }
  }
};

VolumeLoader::VolumeLoader(Commands& commands) : commands_(commands) {}

client::ProgressFunction VolumeLoader::Begin(const std::string& what) {
  task_ = std::make_shared<Task>();
  task_->running.what = what;
  return [task = task_](const client::Progress& progress) {
    const std::lock_guard lock(task->mutex);
    task->running.progress = progress;
    return !task->is_cancelled;
  };
}

void VolumeLoader::Load(const std::string& source, bool discard_edits) {
  if (running()) return;
  const client::ProgressFunction progress = Begin("opening " + NameOf(source));
  task_->opens = true;
  commands_.Do("open", [=, task = task_](client::Client& client) {
    task->Run(source, [&] { return view::Load(client, source, discard_edits, progress); });
  });
}

void VolumeLoader::Save(const std::string& file, SaveWhere where, bool overwrite) {
  if (running()) return;
  const client::ProgressFunction progress = Begin("saving " + NameOf(file));
  commands_.Do("save", [=, task = task_](client::Client& client) {
    task->Run(file, [&] { return view::Save(client, file, where, overwrite, progress); });
  });
}

void VolumeLoader::Cancel() {
  if (!task_) return;
  const std::lock_guard lock(task_->mutex);
  task_->is_cancelled = true;
}

bool VolumeLoader::opens() const { return task_ && task_->opens; }

std::optional<VolumeLoader::Running> VolumeLoader::running() const {
  if (!task_) return std::nullopt;
  const std::lock_guard lock(task_->mutex);
  if (task_->outcome) return std::nullopt;
  return task_->running;
}

std::optional<VolumeLoader::Outcome> VolumeLoader::TakeOutcome() {
  if (!task_) return std::nullopt;
  {
    const std::lock_guard lock(task_->mutex);
    if (!task_->outcome) return std::nullopt;
  }
  return std::exchange(task_, nullptr)->outcome;
}

}  // namespace palpate::view
