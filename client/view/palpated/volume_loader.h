// Opens and saves volumes, one at a time. Both may take minutes.
//
// A path is first tried at palpated, which may run on this machine and read the file itself. If
// palpated is elsewhere or must not read or write there, the voxels go over the connection.
//
// Threads: that of the frames; the calls have a thread of their own (Task). Errors: in the
// outcome.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "client/sdk/calls.h"
#include "client/view/palpated/commands.h"

namespace palpate::view {

// kHere: a path of this machine. kThere: one on palpated's machine.
enum class SaveWhere { kHere, kThere };

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

  // `client` must outlive it. The destructor waits for the call: see Task.
  explicit VolumeLoader(client::Client& client) : task_(client) {}

  // Do nothing if something runs.
  // `source`: a file or folder of this machine, or "builtin:NAME".
  void Load(const std::string& source, bool discard_edits);
  // `file`: ends with .nrrd or .vdb.
  void Save(const std::string& file, SaveWhere where, bool overwrite);
  void Cancel() { task_.Cancel(); }

  // True from the begin of a load until its outcome is taken.
  bool opens() const { return opens_; }
  // None: nothing runs.
  std::optional<Running> running() const;
  // Returns each outcome once.
  std::optional<Outcome> TakeOutcome();

 private:
  using Work = std::function<Outcome(client::Calls&, const client::ProgressFunction&)>;
  void Begin(const std::string& what, const std::string& path, const Work& work);

  bool opens_ = false;
  std::string what_;  // of the newest call
  Task<Outcome> task_;
};

}  // namespace palpate::view
