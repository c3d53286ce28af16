// Runs the stylus's tools: a thread that moves the volume and changes voxels as the samples tell
// (tool_strokes.h).
//
// The servo itself suspends the forces, in the same tick in which the clutch's button is pressed.
// The volume follows a moment later, and ends exactly where the stylus was in the last tick with
// the button held.
//
// Threads: OnScene under the session's lock, OnSample on the pump thread. Neither waits for a
// change: the thread started by Start makes the changes.
// One Undo takes back all carving from a press to its release.
// Errors: a refused change is logged, once per stroke.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "server/session/edits/volume_editor.h"
#include "server/session/session.h"
#include "server/session/tools/tool_strokes.h"

namespace palpate {

class StylusTools final : public SampleSink, public SceneListener {
 public:
  // Borrows both. Listens to the session: construct it before the first Load.
  StylusTools(Session& session, VolumeEditor& editor) : session_(session), editor_(editor) {}
  ~StylusTools() override { Stop(); }

  void Start();
  // Finishes the work that is due.
  void Stop() noexcept;

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;
  void OnSample(const TickSample& sample) override;

  // Does the work that is due now, for callers without the thread.
  void Work() noexcept;

 private:
  void Run();
  void Move(const RigidMotion& motion);
  void Carve(const CarveStep& step);

  Session& session_;
  VolumeEditor& editor_;
  std::uint64_t failed_stroke_ = 0;
  bool move_failed_ = false;

  std::mutex mutex_;  // guards the members below; not held while the session is called
  std::condition_variable due_;
  ToolStrokes strokes_;
  bool is_due_ = false;
  bool stop_ = false;
  std::thread thread_;
  const Listening listening_{session_, *this};
};

}  // namespace palpate
