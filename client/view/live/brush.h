// The edit brush: strokes of the pointer over the surface become edits of the volume,
// and one undo takes back one stroke.
//
// At most one edit of a stroke is under way and one waits, which grows with the pointer
// until its turn comes. Edits overlap along a stroke: what adds or subtracts builds up,
// as an airbrush does.
//
// The daemon has one history for all. Strokes are counted by the revisions of the volume
// that their edits made; where another one is found between (another client's edit, a
// frame of a series, another volume), strokes before it can no longer be taken back alone,
// and are forgotten; so are all where the daemon was started again, for it counts anew.
// Nothing of another client is ever taken back. What the daemon itself has forgotten, for
// want of memory, counts alike; and so does a step without an answer, for it may be done.
//
// Frame: D for points of the surface; edits are sent in W, so that a brush is a ball
// whatever the voxels' spacing is. Lengths are the volume's mm, which a registration
// may scale to other mm of D.
// Threads: that of the frames. Errors: in Commands::problem().
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "client/sdk/edit.h"
#include "client/view/live/commands.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

struct BrushOptions {
  bool on = false;
  client::EditOperation operation = client::EditOperation::kSubtract;
  double radius_mm = 3.0;   // of the volume's mm, W
  double falloff_mm = 1.0;  // likewise
  double value = 0.0;       // data units
  double strength = 0.5;    // for smooth and paint
};

class Brush {
 public:
  Brush();
  ~Brush();
  Brush(const Brush&) = delete;
  Brush& operator=(const Brush&) = delete;

  // Once per frame: strokes of a daemon that was started again are forgotten. `losses`:
  // LiveFeed::losses(), for after a loss it is known late, with the volume, which daemon
  // is back, and until then another one's revisions look like its own.
  void Follow(const ViewVolume& volume, std::uint64_t losses);

  // A point under the pointer while its button is held; sends a sphere, then capsules
  // from point to point once the way is a third of the radius. Does nothing where the
  // brush is off, or the volume is not there or not placed yet.
  void Stroke(const BrushOptions& options, const Vec3& p_D, const ViewVolume& volume,
              Commands& commands);
  // The way to the next point is not along the surface: nothing is drawn along it.
  void Lift();
  // The button was let go.
  void End();

  // For an edit that is made elsewhere: what it is told counts as a stroke of its own. May be
  // called on any thread, once, also when the brush is gone.
  std::function<void(const client::EditResult&)> OtherStroke();

  // Strokes whose edits changed something, of those that are done.
  bool CanUndo() const;
  void Undo(Commands& commands);  // the last stroke
  bool CanRedo() const;
  void Redo(Commands& commands);

 private:
  class History;  // shared with commands
  struct Waiting;

  std::shared_ptr<History> history_;
  std::uint64_t stroke_ = 1;
  std::uint64_t daemon_id_ = 0;  // 0: not known yet
  std::uint64_t losses_ = 0;
  std::uint64_t connection_ = 0;      // counted here; rises with every doubt
  std::optional<Vec3> last_W_;        // where the newest edit of this stroke ends
  std::shared_ptr<Waiting> waiting_;  // the newest edit of this stroke
};

}  // namespace palpate::view
