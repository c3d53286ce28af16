// What this user changes, with undo and redo in one order: settings of palpated, strokes and
// filters, crop box and clip planes. Never undoes what another client did.
//
// Threads: that of the frames. Errors: in LiveFeed::commands().problem().
#pragma once

#include <optional>
#include <string>

#include "client/view/drawing/cut_handles.h"
#include "client/view/palpated/brush.h"
#include "client/view/palpated/history.h"
#include "client/view/palpated/live_feed.h"
#include "client/view/palpated/setting_change.h"

namespace palpate::view {

class UserActions {
 public:
  // `surface`: its crop box and planes are followed. All must outlive this object.
  UserActions(LiveFeed& feed, Brush& brush, SurfaceOptions& surface)
      : feed_(feed), brush_(brush), surface_(surface) {}

  // Changes a setting of palpated. `before`: what the control showed. While the control is held,
  // all changes are one step.
  void Set(const client::Setting& setting, double before, double after);
  // Call it at the end of each frame. `in_hand`: the user holds a control or drags in the view.
  void EndFrame(bool in_hand);

  // Undoes the last step, or redoes one (`forward`). Returns why nothing was done; empty: it was.
  std::string Go(bool forward);
  // What would be undone or redone; empty: nothing.
  std::string undo_name() { return history_.undo_name(); }
  std::string redo_name() { return history_.redo_name(); }
  // For another palpated or another volume. Crop box and planes are as the volume begins with.
  void Forget();

 private:
  void AddStrokes();
  void Add(const SettingChange& change);
  void AddCuts();

  LiveFeed& feed_;
  Brush& brush_;
  SurfaceOptions& surface_;
  History history_;
  SettingDrag drag_;
  Cuts known_cuts_;  // as the newest step left them
};

}  // namespace palpate::view
