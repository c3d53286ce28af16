#include "client/view/live/brush.h"

#include <mutex>
#include <utility>
#include <vector>

namespace palpate::view {
namespace {

using client::Capsule;
using client::Sphere;

constexpr double kWayPerRadius = 1.0 / 3.0;

client::Edit EditOf(const BrushOptions& options) {
  client::Edit edit;
  edit.frame = client::EditFrame::kWorld;
  edit.operation = options.operation;
  edit.value = options.value;
  edit.strength = options.strength;
  edit.falloff = options.falloff_mm;
  return edit;
}

// Extends a waiting edit to a further point.
void Extend(client::Edit& edit, const Vec3& to_W) {
  if (const auto* sphere = std::get_if<Sphere>(&edit.shape)) {
    edit.shape = Capsule{sphere->center, to_W, sphere->radius};
  } else {
    std::get<Capsule>(edit.shape).to = to_W;
  }
}

}  // namespace

// The strokes that can be undone and redone, newest last.
class Brush::History {
 public:
  // Begins anew after a reconnection: a restarted daemon counts its revisions anew.
  void Begin(std::uint64_t connection) {
    const std::lock_guard lock(mutex_);
    Forget();
    connection_ = connection;
    revision_ = 0;
  }

  // `connection`: the connection when the stroke was drawn.
  void Add(std::uint64_t stroke, std::uint64_t connection, const client::EditResult& result) {
    const std::lock_guard lock(mutex_);
    if (connection != connection_) return;
    const std::uint64_t before = result.volume_revision - (result.changed_voxels > 0 ? 1 : 0);
    if (revision_ != before) Forget();
    revision_ = result.volume_revision;
    if (result.changed_voxels == 0) return;
    redo_.clear();
    if (undo_.empty() || undo_.back().number != stroke) undo_.push_back({stroke, 0});
    ++undo_.back().edits;
  }
  bool CanUndo() const {
    const std::lock_guard lock(mutex_);
    return !undo_.empty();
  }
  bool CanRedo() const {
    const std::lock_guard lock(mutex_);
    return !redo_.empty();
  }

  void Undo(client::Client& client) {
    Move(undo_, redo_, [&] { return client.Undo(revision()); });
  }
  void Redo(client::Client& client) {
    Move(redo_, undo_, [&] { return client.Redo(revision()); });
  }

 private:
  struct DoneStroke {
    std::uint64_t number = 0;
    int edits = 0;  // number of edits that changed something
  };
  using Strokes = std::vector<DoneStroke>;

  std::uint64_t revision() const {
    const std::lock_guard lock(mutex_);
    return revision_;
  }
  void Forget() {
    undo_.clear();
    redo_.clear();
  }

  // Goes edit by edit, because the daemon undoes single edits.
  template <typename Step>
  void Move(Strokes& from, Strokes& to, const Step& step) {
    std::unique_lock lock(mutex_);
    if (from.empty()) throw Error(ErrorKind::kConflict, "no stroke is left");
    const std::uint64_t number = from.back().number;
    const std::uint64_t connection = connection_;
    while (!from.empty() && from.back().number == number) {
      lock.unlock();
      const client::EditResult result = TryStep(step);
      lock.lock();
      if (connection != connection_) return;
      revision_ = result.volume_revision;
      if (--from.back().edits == 0) from.pop_back();
      if (to.empty() || to.back().number != number) to.push_back({number, 0});
      ++to.back().edits;
    }
  }
  template <typename Step>
  client::EditResult TryStep(const Step& step) {
    try {
      return step();
    } catch (const Error& error) {
      const std::lock_guard lock(mutex_);
      Forget();
      // Without an answer, the step may be done or not. The count here may then be wrong by one.
      if (error.kind() != ErrorKind::kConflict) throw;
      throw Error(ErrorKind::kConflict,
                  "the volume was changed by others since, so strokes before stay");
    }
  }

  mutable std::mutex mutex_;
  std::uint64_t connection_ = 0;
  std::uint64_t revision_ = 0;  // of the volume after the newest edit; 0: none yet
  Strokes undo_;
  Strokes redo_;
};

// An edit that grows until it can be sent.
struct Brush::Waiting {
  std::mutex mutex;
  std::optional<client::Edit> edit;  // none: already sent
};

Brush::Brush() : history_(std::make_shared<History>()) {}

Brush::~Brush() = default;

void Brush::Follow(const ViewVolume& volume, std::uint64_t losses) {
  const std::uint64_t daemon_id = volume.revision() ? volume.revision()->daemon_id : daemon_id_;
  if (daemon_id == daemon_id_ && losses == losses_) return;
  daemon_id_ = daemon_id;
  losses_ = losses;
  history_->Begin(++connection_);
  End();
}

void Brush::Stroke(const BrushOptions& options, const Vec3& p_D, const ViewVolume& volume,
                   Commands& commands) {
  if (!volume.lattice() || !volume.X_DI()) return;
  const Vec3 p_W = volume.lattice()->X_WI.Apply(volume.X_DI()->Inverse().Apply(p_D));
  if (!p_W.allFinite()) return;
  if (last_W_ && (p_W - *last_W_).norm() < kWayPerRadius * options.radius_mm) return;
  const std::optional<Vec3> from_W = std::exchange(last_W_, p_W);
  if (waiting_) {
    const std::lock_guard lock(waiting_->mutex);
    if (waiting_->edit) {
      Extend(*waiting_->edit, p_W);
      return;
    }
  }
  waiting_ = std::make_shared<Waiting>();
  client::Edit& edit = waiting_->edit.emplace(EditOf(options));
  if (from_W) {
    edit.shape = Capsule{*from_W, p_W, options.radius_mm};
  } else {
    edit.shape = Sphere{p_W, options.radius_mm};
  }
  commands.Do("brush", [waiting = waiting_, history = history_, stroke = stroke_,
                        connection = connection_](client::Client& client) {
    std::unique_lock lock(waiting->mutex);
    const client::Edit sent = *std::exchange(waiting->edit, std::nullopt);
    lock.unlock();
    history->Add(stroke, connection, client.Apply(sent));
  });
}

void Brush::Lift() {
  last_W_.reset();
  waiting_.reset();
}

void Brush::End() {
  Lift();
  ++stroke_;
}

std::function<void(const client::EditResult&)> Brush::OtherStroke() {
  End();
  return [history = history_, stroke = stroke_++, connection = connection_](
             const client::EditResult& result) { history->Add(stroke, connection, result); };
}

bool Brush::CanUndo() const { return history_->CanUndo(); }

void Brush::Undo(Commands& commands) {
  commands.Do("undo of a stroke",
              [history = history_](client::Client& client) { history->Undo(client); });
}

bool Brush::CanRedo() const { return history_->CanRedo(); }

void Brush::Redo(Commands& commands) {
  commands.Do("redo of a stroke",
              [history = history_](client::Client& client) { history->Redo(client); });
}

}  // namespace palpate::view
