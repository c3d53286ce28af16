#include "client/view/viewer/files.h"

#include <utility>

#include "client/sdk/words.h"
#include "client/view/viewer/viewer.h"
#include "common/error/error.h"
#include "common/felt_tool/tool_file.h"
#include "common/wire/address.h"

namespace palpate::view {
namespace {

// A palpated that is there sends its volume before this time: the page does not flash up.
constexpr std::chrono::seconds kPagePatience{1};
constexpr std::string_view kSocketScheme = "unix:";

// False also where this user may not look: palpated may.
bool IsMissing(const std::string& path) {
  std::error_code error;
  return !std::filesystem::exists(path, error) && !error;
}

}  // namespace

bool Files::IsConnected() const {
  return viewer_.feed().connection().state == client::ConnectionState::kConnected;
}

void Files::Follow() {
  daemon_.Poll();
  if (const auto volume = viewer_.feed().volume_info()) {
    daemon_.NoteUnsaved(viewer_.feed().name(), volume->unsaved_edits);
  }
  if (const auto answer = dialog_.Poll()) TakeAnswer(*answer);
  if (const auto outcome = viewer_.feed().loader().TakeOutcome()) TakeOutcome(*outcome);
  FollowPending();
  FollowWarnings();
}

void Files::FollowPending() {
  if (!pending_) return;
  const auto volume = viewer_.feed().volume_info();
  if (IsConnected() && volume) {
    const std::string source = *std::exchange(pending_, std::nullopt);
    // A palpated that was started again may have restored it.
    if (volume->source != source) {
      viewer_.feed().loader().Load(source, false);
    } else {
      page_kept_ = false;
    }
  } else if (!daemon_.problem().empty()) {
    // The page and the card show the daemon's problem.
    pending_.reset();
  }
}

void Files::FollowWarnings() {
  const auto volume = viewer_.feed().volume_info();
  if (!volume) return;
  const std::string of =
      viewer_.feed().name() + ' ' + volume->source + ' ' + std::to_string(volume->loaded_revision);
  if (std::exchange(warned_of_, of) != of) warned_.clear();
  // Some come and go, such as that of a full disk.
  const std::set<std::string> now(volume->warnings.begin(), volume->warnings.end());
  std::erase_if(warnings_, [&](const std::string& line) { return !now.contains(line); });
  for (const std::string& line : volume->warnings) {
    const bool is_shown = std::ranges::count(warnings_, line) > 0;
    if (!warned_.contains(line) && !is_shown) warnings_.push_back(line);
  }
  warned_ = now;
}

std::string Files::WhyNotOpen() const {
  const LiveFeed& feed = viewer_.feed();
  if (feed.loader().running() || pending_) return "something is being opened or saved";
  if (feed.is_stopping()) return "the emergency stop is running";
  if (!IsConnected()) {
    // Here, a palpated is started.
    return feed.is_here() ? "" : "not connected to " + feed.name();
  }
  if (feed.is_replay()) return "a recording is replayed";
  if (feed.May(client::Role::kOperator)) return {};
  return "needs the role operator; yours is " + std::string(NameOf(feed.role()));
}

std::string Files::WhyNotSave() const {
  if (!IsConnected() || !viewer_.feed().volume().lattice()) return "there is no volume";
  if (viewer_.feed().loader().running()) return "something is being opened or saved";
  return {};
}

std::filesystem::path Files::StartFolder() const {
  const std::string& last = viewer_.preferences().last_folder;
  std::error_code error;
  if (!last.empty() && std::filesystem::exists(last, error)) return last;
  if (!recent().empty()) return std::filesystem::path(recent().front()).parent_path();
  return VariableOf("HOME");
}

const std::vector<std::string>& Files::recent() const { return viewer_.preferences().recent_files; }

void Files::Choose(DialogKind kind) {
  const bool opens = kind == DialogKind::kOpenFile || kind == DialogKind::kOpenFolder;
  if (const std::string why = WhyNotOpen(); opens && !why.empty()) {
    viewer_.Say("cannot open a volume: " + why);
    return;
  }
  const bool saves = kind == DialogKind::kSave;
  if (dialog_.Open(kind, saves ? std::filesystem::path(form_.path) : StartFolder())) return;
  if (!saves) TypePath();
}

void Files::TypePath() {
  form_ = {.shown = true, .path = StartFolder().string(), .has_dialog = FileDialog::IsInstalled()};
  if (!form_.path.ends_with('/')) form_.path += '/';
}

void Files::TakeAnswer(const FileDialog::Answer& answer) {
  if (!answer.path) return;
  viewer_.preferences().last_folder = answer.path->parent_path().string();
  if (answer.kind != DialogKind::kSave) {
    Open(answer.path->string());
    return;
  }
  form_.path = answer.path->string();
  form_.is_confirmed = true;
}

void Files::Open(const std::string& source) {
  problem_.clear();
  ask_ = Ask::kNothing;
  form_.shown = false;
  if (source.ends_with(".toml")) {
    WishTool(source);
  } else if (const std::string why = WhyNotOpen(); !why.empty()) {
    problem_ = "cannot open " + source + ": " + why;
  } else if (!IsSample(source) && IsMissing(source)) {
    problem_ = "there is no file or folder " + source;
  } else if (IsConnected()) {
    viewer_.feed().loader().Load(source, false);
  } else {
    StartHere(/*fresh=*/true);
    if (problem_.empty()) pending_ = source;
    // If it cannot be opened, palpated's own sample is not shown in its place.
    page_kept_ = !viewer_.feed().volume().lattice() && daemon_.runs();
  }
}

void Files::WishTool(const std::string& path) try {
  const HeldTool tool = ReadTool(path);
  if (!IsConnected() || !viewer_.feed().settings() || !viewer_.feed().May(client::Role::kEditor)) {
    problem_ = "to take a tool, connect to a palpated, with the role editor";
    return;
  }
  viewer_.state().wished_tool = tool;
  // The panel asks.
  viewer_.preferences().right_shown = true;
  viewer_.preferences().narrow_side = Side::kRight;
} catch (const Error& error) {
  problem_ = error.what();
}

void Files::StartAgain() {
  // Copied: another connection begins without a volume.
  const auto lattice = viewer_.feed().volume().lattice();
  StartHere(/*fresh=*/false);
  if (daemon_.runs() && lattice) pending_ = lattice->source;
}

void Files::ForgetServer() {
  ask_ = Ask::kNothing;
  problem_.clear();
  pending_.reset();
  page_kept_ = false;
  form_.where = SaveWhere::kHere;
  form_.is_confirmed = false;
  viewer_.state().wished_tool.reset();
  warnings_.clear();
  warned_of_.clear();
}

void Files::Drop(const std::vector<std::string>& paths) {
  if (paths.size() == 1) {
    Open(paths.front());
  } else if (!paths.empty()) {
    problem_ = "drop one file, or the folder that holds the files of one volume";
  }
}

void Files::BeginSave() {
  if (const std::string why = WhyNotSave(); !why.empty()) {
    viewer_.Say("cannot save: " + why);
    return;
  }
  const std::filesystem::path source(viewer_.feed().volume().lattice()->source);
  std::string name = source.filename().string();
  name = name.substr(name.rfind(':') + 1);
  name = name.substr(0, name.find('.'));
  form_ = {.shown = true,
           .saves = true,
           .path = StartFolder() / (name + "-edited.nrrd"),
           .has_dialog = FileDialog::IsInstalled()};
}

void Files::Save(bool overwrite) {
  problem_.clear();
  ask_ = Ask::kNothing;
  viewer_.feed().loader().Save(form_.path, form_.where, overwrite || form_.is_confirmed);
  form_.shown = false;
}

void Files::Revert() {
  viewer_.feed().shared().NoteOwn("voxels");
  viewer_.feed().commands().Do("revert", [done = viewer_.brush().OtherStroke("revert")](
                                             client::Client& client) { done(client.Revert()); });
}

void Files::TakeOutcome(const VolumeLoader::Outcome& outcome) {
  using Result = VolumeLoader::Result;
  asked_ = outcome;
  switch (outcome.result) {
    case Result::kLoaded:
      page_kept_ = false;
      viewer_.Say(outcome.text);
      if (IsSample(outcome.path)) break;
      PutFirst(std::filesystem::absolute(outcome.path).string(),
               viewer_.preferences().recent_files);
      break;
    case Result::kSaved:
    case Result::kCancelled:
      viewer_.Say(outcome.text);
      break;
    case Result::kFailed:
      problem_ = outcome.text;
      break;
    case Result::kUnsaved:
      ask_ = Ask::kDiscard;
      break;
    case Result::kExists:
      ask_ = Ask::kReplace;
      break;
  }
}

void Files::Confirm() {
  const Ask ask = std::exchange(ask_, Ask::kNothing);
  if (ask == Ask::kDiscard) viewer_.feed().loader().Load(asked_.path, true);
  if (ask == Ask::kReplace) viewer_.feed().loader().Save(asked_.path, asked_.where, true);
  if (ask == Ask::kClose) closes_ = true;
}

void Files::Dismiss() {
  ask_ = Ask::kNothing;
  problem_.clear();
}

void Files::StartHere(bool fresh) {
  problem_.clear();
  if (viewer_.feed().is_stopping()) return;
  const std::string name = viewer_.feed().name();
  try {
    const std::string socket = viewer_.feed().is_here()
                                   ? UsualSocketPath(name.substr(kSocketScheme.size()))
                                   : DefaultSocketPath();
    if (!IsServed(socket)) daemon_.Start(socket, PreferencesFile().parent_path(), fresh);
    viewer_.Connect({.address = {.socket_path = socket, .role = viewer_.server().address.role}});
  } catch (const Error& error) {
    problem_ = error.what();
  }
}

void Files::StartHereFromPage() {
  StartHere(/*fresh=*/true);
  page_kept_ = daemon_.runs();
}

bool Files::PageShown() {
  if (viewer_.state().connect.shown) return false;
  if (page_kept_) return true;
  const LiveFeed& feed = viewer_.feed();
  if (feed.volume().lattice()) {
    empty_since_.reset();
    return false;
  }
  if (!empty_since_) empty_since_ = Clock::now();
  const bool is_lost = feed.connection().state == client::ConnectionState::kLost;
  return is_lost || feed.volume_status().is_loading || Clock::now() - *empty_since_ > kPagePatience;
}

bool Files::MayClose() {
  if (closes_ || !daemon_.LosesEdits()) return true;
  asked_ = {.unsaved_edits = daemon_.unsaved_edits()};
  ask_ = Ask::kClose;
  return false;
}

}  // namespace palpate::view
