#include "client/view/viewer/user_actions.h"

#include <atomic>
#include <memory>
#include <utility>

#include "client/view/palpated/shared_things.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

// Empty if palpated does not answer: the user already sees the error that the name would explain.
std::string ChangedBy(client::Client& client, std::initializer_list<std::string_view> things) {
  try {
    return ChangedByInWords(client.GetActivity(), things);
  } catch (const Error&) {
    return "";
  }
}

std::string VoxelsChangedBy(client::Client& client) {
  return ChangedBy(client, {"voxels", "volume", "series"});
}

// Runs on the commands' thread.
void Restore(client::Client& client, const SettingChange& change, bool forward) {
  const SettingAccess access = {
      .get = [&] { return client.GetSettings(); },
      .set = [&](const client::SettingsUpdate& update) { client.Set(update); },
      .changed_by =
          [&] {
            return ChangedBy(client, {change.setting->key, "volume"});
          }};
  RestoreSetting(change, forward, access);
}

}  // namespace

void UserActions::Set(const client::Setting& setting, double before, double after) {
  if (before == after) return;
  feed_.shared().NoteOwn(setting.key);
  feed_.commands().Set(UpdateTo(setting, after));
  if (const auto ended = drag_.Add({&setting, before, after})) Add(*ended);
}

void UserActions::Add(const SettingChange& change) {
  const std::string name(change.setting->name);
  const auto lasts = std::make_shared<std::atomic<bool>>(true);
  const auto go = [this, change, name, lasts](bool forward) {
    feed_.shared().NoteOwn(change.setting->key);
    const auto restore = [change, lasts, forward](client::Client& client) {
      try {
        Restore(client, change, forward);
      } catch (const Error&) {
        *lasts = false;
        throw;
      }
    };
    feed_.commands().Do((forward ? "redo of " : "undo of ") + name, restore);
  };
  history_.Add({.name = name, .go = go, .lasts = [lasts] { return lasts->load(); }});
}

void UserActions::AddStrokes() {
  for (const Brush::BegunStroke& stroke : brush_.TakeBegun()) {
    feed_.shared().NoteOwn("voxels");
    const auto go = [this, number = stroke.number](bool forward) {
      feed_.shared().NoteOwn("voxels");
      brush_.Restore(number, forward, feed_.commands(), VoxelsChangedBy);
    };
    history_.Add({.name = stroke.name, .go = go, .lasts = brush_.LastsOf(stroke.number)});
  }
}

void UserActions::AddCuts() {
  const Cuts after = CutsOf(surface_);
  if (after == known_cuts_) return;
  const Cuts before = std::exchange(known_cuts_, after);
  const auto show = [this](const Cuts& cuts) {
    surface_.crop = cuts.crop;
    for (std::size_t n = 0; n < cuts.planes.size(); ++n) {
      // A plane that is off keeps its place, for when the user switches it on again.
      surface_.planes[n].on = cuts.planes[n].on;
      if (cuts.planes[n].on) surface_.planes[n] = cuts.planes[n];
    }
    known_cuts_ = CutsOf(surface_);
  };
  history_.Add({.name = before.planes == after.planes ? "crop box" : "clip plane",
                .go = [show, before, after](bool forward) { show(forward ? after : before); }});
}

void UserActions::EndFrame(bool in_hand) {
  AddStrokes();
  if (brush_.is_waiting()) feed_.shared().NoteOwn("voxels");
  if (in_hand) return;
  if (const auto ended = drag_.End()) Add(*ended);
  AddCuts();
}

std::string UserActions::Go(bool forward) {
  // What is in hand counts as done.
  EndFrame(false);
  if (feed_.connection().state != client::ConnectionState::kConnected) {
    return "not connected: nothing can be undone or redone now";
  }
  if (forward ? history_.Redo() : history_.Undo()) return {};
  return forward ? "nothing to redo" : "nothing to undo";
}

void UserActions::Forget() {
  history_.Forget();
  brush_.TakeBegun();
  drag_ = {};
  known_cuts_ = CutsOf(surface_);
}

}  // namespace palpate::view
