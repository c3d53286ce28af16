#include "client/view/palpated/volume_loader.h"

#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <thread>
#include <utility>

#include "client/files/download_file.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

using Outcome = VolumeLoader::Outcome;
using Result = VolumeLoader::Result;

constexpr std::chrono::milliseconds kLoadingPause{100};

std::string NameOf(const std::string& path) {
  const std::filesystem::path whole(path);
  // A folder's name may end with a slash.
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

// Calls palpated with a path of this machine. False if palpated is elsewhere or cannot use the
// path, which may be right all the same.
bool TryAtPalpated(const client::Calls& palpated, const std::function<void()>& call) {
  if (!palpated.shares_clock()) return false;
  try {
    call();
    return true;
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kPermissionDenied || error.kind() == ErrorKind::kNotFound) {
      return false;
    }
    throw;
  }
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
  const client::LoadOptions options{.discard_edits = discard_edits};
  const auto load = [&](const std::string& path) { palpated.LoadVolume(path, options, progress); };
  if (source.starts_with("builtin:")) {
    load(source);
  } else if (!TryAtPalpated(palpated, [&] { load(std::filesystem::absolute(source)); })) {
    palpated.UploadVolume(source, options, progress);
  }
  return {.result = Result::kLoaded, .path = source, .text = "opened " + NameOf(source)};
}

// Returns the file's bytes.
std::uint64_t SaveTo(client::Calls& palpated, const std::string& file, SaveWhere where,
                     bool overwrite, const client::ProgressFunction& progress) {
  if (where == SaveWhere::kThere) return palpated.SaveVolume(file, overwrite, progress).size_bytes;
  std::uint64_t bytes = 0;
  // Unlike a copy, a save by palpated counts as saved.
  const auto save = [&] {
    bytes = palpated.SaveVolume(std::filesystem::absolute(file), overwrite, progress).size_bytes;
  };
  if (TryAtPalpated(palpated, save)) return bytes;
  const auto check = [&progress] {
    if (!progress({.stage = "writing", .fraction = 1.0})) {
      throw Error(ErrorKind::kCancelled, "no file was written");
    }
  };
  client::DownloadToFile(palpated, file, overwrite, progress, check);
  std::error_code error;
  bytes = std::filesystem::file_size(file, error);
  return error ? 0 : bytes;
}

Outcome Save(client::Calls& palpated, const std::string& file, SaveWhere where, bool overwrite,
             const client::ProgressFunction& progress) {
  Outcome outcome{.result = Result::kSaved, .path = file, .where = where};
  try {
    const std::uint64_t bytes = SaveTo(palpated, file, where, overwrite, progress);
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

void VolumeLoader::Begin(const std::string& what, const std::string& path, const Work& work) {
  what_ = what + NameOf(path);
  task_.Start("open or save",
              [path, work](client::Client& palpated, const client::ProgressFunction& progress) {
                Outcome outcome{.result = Result::kFailed, .path = path};
                try {
                  outcome = work(palpated, progress);
                } catch (const Error& error) {
                  if (error.kind() == ErrorKind::kCancelled) outcome.result = Result::kCancelled;
                  outcome.text = error.what();
                } catch (const std::exception& error) {
                  outcome.text = error.what();
                }
                return outcome;
              });
}

void VolumeLoader::Load(const std::string& source, bool discard_edits) {
  if (running()) return;
  opens_ = true;
  Begin("opening ", source, [=](client::Calls& palpated, const client::ProgressFunction& progress) {
    return view::Load(palpated, source, discard_edits, progress);
  });
}

void VolumeLoader::Save(const std::string& file, SaveWhere where, bool overwrite) {
  if (running()) return;
  opens_ = false;
  Begin("saving ", file, [=](client::Calls& palpated, const client::ProgressFunction& progress) {
    return view::Save(palpated, file, where, overwrite, progress);
  });
}

std::optional<VolumeLoader::Running> VolumeLoader::running() const {
  const std::optional<client::Progress> progress = task_.progress();
  if (!progress) return std::nullopt;
  return Running{.what = what_, .progress = *progress};
}

std::optional<VolumeLoader::Outcome> VolumeLoader::TakeOutcome() {
  std::optional<Outcome> outcome = task_.Take();
  if (outcome) opens_ = false;
  return outcome;
}

}  // namespace palpate::view
