// What the user opens and saves, and the palpated that the viewer starts: keeps the file dialog,
// the loader and the local palpated together, and the questions between them. The panels show it.
//
// Threads: that of the frames; nothing waits. Errors: in problem().
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "client/view/palpated/file_dialog.h"
#include "client/view/palpated/local_daemon.h"
#include "client/view/palpated/volume_loader.h"

namespace palpate::view {

class Viewer;

// A volume that palpated makes itself.
struct Sample {
  const char* source;
  const char* name;
  const char* what;
};
inline constexpr Sample kSamples[] = {
    {"builtin:bumps", "Bumps", "a ball with hills and hollows"},
    {"builtin:sphere", "Sphere", "a ball, to compare with the exact answer"},
    {"builtin:gyroid", "Gyroid", "a labyrinth with one curved wall"},
    {"builtin:cylinder", "Cylinder", "a rod; the isovalue is its radius"},
};

inline bool IsSample(const std::string& source) { return source.starts_with("builtin:"); }

class Files {
 public:
  enum class Ask { kNothing, kDiscard, kReplace, kClose };
  // The field for a path, where there is no dialog or the user likes to type.
  struct PathForm {
    bool shown = false;
    bool saves = false;
    std::string path{};
    SaveWhere where = SaveWhere::kHere;
    bool is_confirmed = false;  // the dialog has asked whether to replace `path`
    bool has_dialog = false;    // a program for dialogs is installed
  };

  explicit Files(Viewer& viewer) : viewer_(viewer) {}

  // Takes what came: call it once per frame.
  void Follow();

  // Why nothing can be opened or saved now; empty: it can.
  std::string WhyNotOpen() const;
  std::string WhyNotSave() const;
  // Opens the dialog; if none is installed, the form.
  void Choose(DialogKind kind);
  void TypePath();
  // `source`: a path of this machine, or a sample. If no palpated runs here yet, starts one first.
  // A .toml file is a tool: see ViewState::wished_tool.
  void Open(const std::string& source);
  // What waits for another palpated is void, and so is every question.
  void ForgetServer();
  void Drop(const std::vector<std::string>& paths);
  void BeginSave();
  void Save(bool overwrite);
  void Revert();

  // After the palpated of this window has ended: another one, with the same volume.
  void StartAgain();
  // Starts a palpated on this machine unless one runs, and connects to it. Keeps the start page, so
  // that the user can choose what to open.
  void StartHereFromPage();
  bool PageShown();
  void ClosePage() { page_kept_ = false; }
  bool is_page_kept() const { return page_kept_; }

  // The question that waits for an answer.
  Ask ask() const { return ask_; }
  bool has_question() const { return ask_ != Ask::kNothing || !problem_.empty(); }
  const VolumeLoader::Outcome& asked() const { return asked_; }
  void Confirm();
  void Dismiss();

  // True if the window may close: nothing is lost. Otherwise asks.
  bool MayClose();
  bool closes() const { return closes_; }

  const std::string& problem() const { return problem_; }
  const std::vector<std::string>& warnings() const { return warnings_; }
  void DismissWarnings() { warnings_.clear(); }
  const std::vector<std::string>& recent() const;
  PathForm& form() { return form_; }
  LocalDaemon& daemon() { return daemon_; }
  const LocalDaemon& daemon() const { return daemon_; }
  // What is opened when palpated is there.
  const std::optional<std::string>& pending() const { return pending_; }
  void CancelPending() { pending_.reset(); }

 private:
  using Clock = std::chrono::steady_clock;

  void WishTool(const std::string& path);
  // `fresh`: as LocalDaemon::Start.
  void StartHere(bool fresh);
  void TakeAnswer(const FileDialog::Answer& answer);
  void TakeOutcome(const VolumeLoader::Outcome& outcome);
  void FollowPending();
  void FollowWarnings();
  bool IsConnected() const;
  std::filesystem::path StartFolder() const;

  Viewer& viewer_;
  FileDialog dialog_;
  LocalDaemon daemon_;
  PathForm form_;
  std::optional<std::string> pending_;
  Ask ask_ = Ask::kNothing;
  VolumeLoader::Outcome asked_;
  std::string problem_;
  std::set<std::string> warned_;  // of this volume
  std::vector<std::string> warnings_;
  std::string warned_of_;  // the volume whose warnings were taken
  bool page_kept_ = false;
  bool closes_ = false;
  std::optional<Clock::time_point> empty_since_;
};

}  // namespace palpate::view
