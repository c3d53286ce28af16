// Opens and saves volumes, one at a time. Both may take minutes.
//
// A path is first tried at palpated, which may run on this machine and read the file itself. If
// palpated is elsewhere or must not read or write there, the voxels go over the connection.
//
// Threads: that of the frames; the calls have a thread of their own (Commands). Errors: in the
// outcome.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/calls.h"
#include "client/view/live/commands.h"

namespace palpate::view {

// `source`: a file or folder of this machine, or "builtin:NAME".
client::LoadResult LoadFromHere(client::Calls& palpated, const std::string& source,
                                const client::LoadOptions& options,
                                const client::ProgressFunction& progress);

enum class SaveWhere { kHere, kThere };

// `file`: ends with .nrrd or .vdb. kThere: a path on palpated's machine. Returns the file's bytes.
std::uint64_t SaveVolume(client::Calls& palpated, const std::string& file, SaveWhere where,
                         bool overwrite, const client::ProgressFunction& progress);

class VolumeLoader {
 public:
  enum class Result {
    kLoaded,
    kSaved,
    kCancelled,
    kFailed,
    kUnsaved,  // edits would be lost; load again with `discard_edits`
    kExists,   // the file exists; save again with `overwrite`
  };
  struct Outcome {
    Result result{};
    std::string path{};               // that was opened or saved
    std::string text{};               // one line for people
    SaveWhere where{};                // of a save
    std::uint64_t unsaved_edits = 0;  // for kUnsaved
  };
  struct Running {
    std::string what{};  // "opening head.nrrd"
    client::Progress progress{};
  };

  // `commands`: used for nothing else, because commands wait for the load. It must outlive the
  // loader.
  explicit VolumeLoader(Commands& commands);

  // Do nothing if something runs.
  void Load(const std::string& source, bool discard_edits);
  void Save(const std::string& file, SaveWhere where, bool overwrite);
  void Cancel();

  // True from the begin of a load until its outcome is taken.
  bool opens() const;
  // None: nothing runs.
  std::optional<Running> running() const;
  // Returns each outcome once.
  std::optional<Outcome> TakeOutcome();

 private:
  struct Task;
  client::ProgressFunction Begin(const std::string& what);

  Commands& commands_;
  std::shared_ptr<Task> task_;
};

}  // namespace palpate::view
