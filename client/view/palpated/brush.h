// The edit brush: strokes of the pointer over the surface become edits of the volume. One undo
// takes back one stroke.
//
// A stroke is a row of short capsules, a third of the radius long, which are sent one after the
// other. Longer ones would cut through a curved surface. The daemon joins them to one step, which
// acts once on each voxel: Edit::stroke. If an edit fails, the rest of its stroke is dropped.
//
// The daemon has one history for all clients. The brush counts strokes by the volume revisions of
// their edits, and never undoes an edit of another client: it forgets strokes that it can no longer
// undo alone:
// - strokes before a foreign revision (an edit of another client, a frame of a series, another
//   volume)
// - all strokes if the daemon was restarted, because it then counts anew
// - strokes that the daemon itself has forgotten for lack of memory
// - strokes around a step without an answer, which may or may not be done
//
// Frame: D for points of the surface. Edits are sent in W, so that a brush is a ball for every
// voxel spacing. Lengths are the volume's mm; a registration may scale them to other mm of D.
// Threads: that of the frames. Errors: in Commands::problem().
#pragma once

#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/edit.h"
#include "client/view/palpated/commands.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

struct BrushOptions {
  // The values become the volume's last on the free side of the isovalue. Otherwise `operation`.
  bool removes = true;
  bool free_above = false;  // the side
  client::EditOperation operation = client::EditOperation::kAdd;
  double radius_mm = 3.0;   // mm of the volume, W
  double falloff_mm = 1.0;  // likewise
  double value = 0.0;       // data units
  double strength = 0.5;    // for smooth and paint
};

inline constexpr double kLeastBrush_mm = 0.1;
inline constexpr double kGreatestBrush_mm = 100.0;

class Brush {
 public:
  Brush();
  Brush(const Brush&) = delete;
  Brush& operator=(const Brush&) = delete;

  // Call it once per frame. Forgets strokes if the daemon was restarted. `losses`:
  // LiveFeed::losses(). After a loss, only the volume tells which daemon is back. Until the volume
  // arrives, revisions of another daemon look like those of the old one.
  void Follow(const ViewVolume& volume, std::uint64_t losses);

  // Call it with the point under the pointer while the button is held. Sends a sphere first, then a
  // capsule from point to point whenever the path is a third of the radius. Does nothing if
  // the volume is missing or has no place yet.
  void Stroke(const BrushOptions& options, const Vec3& p_D, const ViewVolume& volume,
              Commands& commands);
  // The path to the next point leaves the surface: nothing is drawn along it.
  void Lift();
  // Call it when the button was released.
  void End();

  // For an edit made elsewhere: the result given to the returned function counts as a stroke of its
  // own. The function may be called once, on any thread, also after the brush is destroyed. `name`:
  // for people, such as "filter".
  std::function<void(const client::EditResult&)> OtherStroke(std::string name);

  // The stylus, which this viewer led, has carved since `begun`: from one revision of the volume to
  // another. It counts as a stroke of its own unless somebody edited meanwhile.
  void Carved(std::uint64_t from_revision, std::uint64_t to_revision,
              std::chrono::steady_clock::time_point begun, Commands& commands);

  // True if an edit of a stroke waits for its answer.
  bool is_waiting() const;

  // For a history of all that the user does.
  struct BegunStroke {
    std::uint64_t number = 0;
    std::string name{};
  };
  // The strokes that were begun since the last call; those made elsewhere, when they are done.
  std::vector<BegunStroke> TakeBegun();
  // False if the stroke changed nothing, or was forgotten. The function may be called later, on any
  // thread.
  std::function<bool()> LastsOf(std::uint64_t number) const;
  // Undoes this stroke, or redoes it (`forward`), if it is the last one; an error of the commands
  // otherwise. `changed_by`: names who changed the voxels last, for the error; called on the
  // commands' thread; may be empty.
  using ChangedBy = std::function<std::string(client::Client&)>;
  void Restore(std::uint64_t number, bool forward, Commands& commands, ChangedBy changed_by);

 private:
  class History;  // shared with commands

  std::shared_ptr<History> history_;
  const std::uint64_t first_number_;  // of strokes for the daemon
  std::uint64_t stroke_ = 1;
  std::uint64_t daemon_id_ = 0;  // 0: not known yet
  std::uint64_t losses_ = 0;
  std::uint64_t connection_ = 0;  // counted here; rises whenever the daemon may be another one
  std::optional<Vec3> last_W_;    // where the newest edit of this stroke ends
  // Of an edit of this stroke; null: none failed. Read and written on the commands' thread.
  std::shared_ptr<std::exception_ptr> failure_;
};

}  // namespace palpate::view
