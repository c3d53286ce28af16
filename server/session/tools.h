// The tools of the stylus at work: a thread that moves the volume and changes
// voxels as the samples say (tool_strokes.h).
//
// The servo suspends the forces by itself, in the very tick in which the clutch's
// button is held; here, a moment later, the volume follows. The volume ends exactly
// where the last held tick had the stylus.
//
// Threads: OnScene under the session's lock, OnSample on the pump thread, neither of
// which ever waits for a change; changes are made on the thread that Start starts.
// Undoing takes back what was carved from a press to the release.
// Errors: a change that is refused is said in the log, once a stroke.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "server/session/session.h"
#include "server/session/tool_strokes.h"
#include "server/session/volume_editor.h"

namespace palpate {

class StylusTools final : public SampleSink, public SceneListener {
 public:
  // Borrows both. The session tells it of every scene: before the first Load.
  StylusTools(Session& session, VolumeEditor& editor) : session_(session), editor_(editor) {}
  ~StylusTools() override { Stop(); }

  void Start();
  // What is due is done before.
  void Stop() noexcept;

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;
  void OnSample(const TickSample& sample) override;

  // Does what is due now: the work of the thread, for those who have none.
  void Work() noexcept;

 private:
  void Run();
  void Move(const RigidMotion& motion);
  void Carve(const CarveStep& step);

  Session& session_;
  VolumeEditor& editor_;
  std::uint64_t failed_stroke_ = 0;
  bool move_failed_ = false;

  std::mutex mutex_;  // guards what follows; not held while the session is called
  std::condition_variable due_;
  ToolStrokes strokes_;
  bool is_due_ = false;
  bool stop_ = false;
  std::thread thread_;
  const Listening listening_{session_, *this};
};

}  // namespace palpate
