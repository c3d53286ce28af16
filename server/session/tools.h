// The tools of the stylus at work: a thread that moves the volume and changes
// voxels as the samples say (tool_strokes.h).
//
// The servo suspends the forces by itself, in the very tick in which the clutch's
// button is held; here, a moment later, the volume follows. The volume ends exactly
// where the last held tick had the stylus.
//
// Threads: OnScene under the session's lock, OnSample on the pump thread, neither of
// which ever waits for a change; changes are made on the thread that Start starts.
// Errors: a change that is refused is said in the log, once a stroke.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include "server/session/session.h"
#include "server/session/tool_strokes.h"

namespace palpate {

class StylusTools final : public SampleSink, public SceneListener {
 public:
  // Changes the voxels of one step, within the volume. May throw.
  using Carver = std::function<void(const CarveStep& step)>;

  // Borrows the session, to which it is to be added as a listener before the first
  // load.
  StylusTools(Session& session, Carver carver);
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
  Carver carver_;
  std::uint64_t failed_stroke_ = 0;
  bool move_failed_ = false;

  std::mutex mutex_;  // guards what follows; not held while the session is called
  std::condition_variable due_;
  ToolStrokes strokes_;
  bool is_due_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
