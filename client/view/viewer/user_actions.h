// What this user changes, with undo and redo in one order: settings of palpated, strokes and
// filters, crop box and clip planes. Never undoes what another client did.
//
// Threads: that of the frames. Errors: in LiveFeed::commands().problem().
#pragma once

#include <chrono>
#include <cmath>
#include <optional>
#include <string>

#include "client/view/drawing/cut_handles.h"
#include "client/view/palpated/brush.h"
#include "client/view/palpated/history.h"
#include "client/view/palpated/live_feed.h"
#include "client/view/palpated/setting_change.h"

namespace palpate::view {

// A value that palpated owns and the user is changing here. The control shows the user's value
// until palpated has it. Soon after the user has let go, the control shows palpated's value again.
//
// Threads: that of the frames.
class HeldValues {
 public:
  using Clock = std::chrono::steady_clock;
  // Longer than palpated takes to answer, and longer than between two facts about a series.
  static constexpr std::chrono::milliseconds kPatience{1500};

  // Returns the value that control `id` shows while palpated's value is `told`.
  double Shown(unsigned id, double told, Clock::time_point now = Clock::now()) {
    if (id != id_) return told;
    const bool agreed = std::abs(told - value_) <= 1e-9 * (1.0 + std::abs(value_));
    // Checks the time also while in_hand_: a control that is hidden meanwhile never reports that
    // the user let go.
    if ((agreed && !in_hand_) || now > until_) {
      id_ = 0;
      return told;
    }
    return value_;
  }

  // The value was changed from elsewhere, as by an undo.
  void LetGo() { id_ = 0; }

  // Call it after the control was drawn. `changed`: the user changed the value. `in_hand`: the user
  // still holds the control.
  void Update(unsigned id, double value, bool changed, bool in_hand,
              Clock::time_point now = Clock::now()) {
    if (changed) {
      id_ = id;
      value_ = value;
    }
    if (id != id_) return;
    in_hand_ = in_hand;
    if (changed || in_hand) until_ = now + kPatience;
  }

 private:
  unsigned id_ = 0;  // 0: nothing is held
  double value_ = 0.0;
  bool in_hand_ = false;
  Clock::time_point until_{};
};

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
