#include "client/view/palpated/brush.h"

#include <algorithm>
#include <exception>
#include <mutex>
#include <random>
#include <set>
#include <utility>

namespace palpate::view {
namespace {

constexpr double kWayPerRadius = 1.0 / 3.0;
// How much older than the newest the volume's revision here may be.
constexpr double kStale_s = 0.5;

client::Edit EditOf(const BrushOptions& options, const VolumeLattice& lattice) {
  client::Edit edit;
  edit.frame = client::EditFrame::kWorld;
  edit.operation = options.removes ? client::EditOperation::kSet : options.operation;
  const double free = options.free_above ? lattice.value_max : lattice.value_min;
  edit.value = options.removes ? free : options.value;
  edit.strength = options.strength;
  edit.falloff = options.falloff_mm;
  return edit;
}

}  // namespace

// The strokes that can be undone and redone, newest last.
class Brush::History {
 public:
  // Begins anew after a reconnection: a restarted daemon counts its revisions anew.
  void Begin(std::uint64_t connection) {
    const std::lock_guard lock(mutex_);
    Forget();
    asked_.clear();
    begun_.clear();
    connection_ = connection;
    revision_ = 0;
  }

  // An edit of the stroke was asked for.
  void Ask(std::uint64_t stroke) {
    const std::lock_guard lock(mutex_);
    asked_.insert(stroke);
    if (newest_begun_ == stroke) return;
    newest_begun_ = stroke;
    begun_.push_back({stroke, "stroke"});
  }
  // The edit has an answer or has failed.
  void Answered(std::uint64_t stroke) {
    const std::lock_guard lock(mutex_);
    if (const auto at = asked_.find(stroke); at != asked_.end()) asked_.erase(at);
  }
  void AddOther(std::uint64_t stroke, const std::string& name, std::uint64_t connection,
                const client::EditResult& result) {
    Add(stroke, connection, result);
    const std::lock_guard lock(mutex_);
    if (connection == connection_) begun_.push_back({stroke, name});
  }
  void AddCarved(std::uint64_t stroke, std::uint64_t connection, std::uint64_t from_revision,
                 std::uint64_t to_revision) {
    const std::lock_guard lock(mutex_);
    if (connection != connection_) return;
    if (revision_ != from_revision) Forget();
    revision_ = to_revision;
    redo_.clear();
    undo_.push_back(stroke);
    begun_.push_back({stroke, "carving"});
  }
  bool is_waiting() const {
    const std::lock_guard lock(mutex_);
    return !asked_.empty();
  }
  std::vector<BegunStroke> TakeBegun() {
    const std::lock_guard lock(mutex_);
    return std::exchange(begun_, {});
  }
  bool Lasts(std::uint64_t stroke) const {
    const std::lock_guard lock(mutex_);
    return asked_.contains(stroke) || std::count(undo_.begin(), undo_.end(), stroke) > 0 ||
           std::count(redo_.begin(), redo_.end(), stroke) > 0;
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
    if (undo_.empty() || undo_.back() != stroke) undo_.push_back(stroke);
  }

  void Restore(std::uint64_t stroke, bool forward, client::Client& client,
               const ChangedBy& changed_by) {
    std::unique_lock lock(mutex_);
    std::vector<std::uint64_t>& from = forward ? redo_ : undo_;
    std::vector<std::uint64_t>& to = forward ? undo_ : redo_;
    const bool is_there = !from.empty() && from.back() == stroke;
    if (!is_there) throw Error(ErrorKind::kConflict, "no stroke is left");
    const std::uint64_t connection = connection_;
    const std::uint64_t revision = revision_;
    lock.unlock();
    client::EditResult result;
    try {
      result = forward ? client.Redo(revision) : client.Undo(revision);
    } catch (const Error& error) {
      // Without an answer, the step may be done or not. The count here may then be wrong by one.
      lock.lock();
      Forget();
      lock.unlock();
      if (error.kind() != ErrorKind::kConflict) throw;
      const std::string who = changed_by ? changed_by(client) : std::string();
      throw Error(ErrorKind::kConflict, "the volume was changed since by " +
                                            (who.empty() ? "others" : who) +
                                            ", so strokes before stay");
    }
    lock.lock();
    if (connection != connection_) return;
    revision_ = result.volume_revision;
    // A filter's result may have emptied it meanwhile.
    if (!from.empty() && from.back() == stroke) from.pop_back();
    to.push_back(stroke);
  }

 private:
  void Forget() {
    undo_.clear();
    redo_.clear();
  }

  mutable std::mutex mutex_;
  std::uint64_t connection_ = 0;
  std::uint64_t revision_ = 0;  // of the volume after the newest edit; 0: none yet
  std::vector<std::uint64_t> undo_;
  std::vector<std::uint64_t> redo_;
  std::multiset<std::uint64_t> asked_;  // the stroke of each edit that has no answer yet
  std::uint64_t newest_begun_ = 0;
  std::vector<BegunStroke> begun_;
};

// Random: other clients number their strokes, too.
Brush::Brush()
    : history_(std::make_shared<History>()),
      first_number_(std::uint64_t{std::random_device()()} << 32),
      failure_(std::make_shared<std::exception_ptr>()) {}

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
  client::Edit edit = EditOf(options, *volume.lattice());
  edit.stroke = first_number_ + stroke_;
  edit.shape = client::Sphere{p_W, options.radius_mm};
  if (from_W) edit.shape = client::Capsule{*from_W, p_W, options.radius_mm};
  history_->Ask(stroke_);
  commands.Do("brush", [edit, failure = failure_, history = history_, stroke = stroke_,
                        connection = connection_](client::Client& client) {
    try {
      if (*failure) std::rethrow_exception(*failure);
      history->Add(stroke, connection, client.Apply(edit));
    } catch (...) {
      *failure = std::current_exception();
      history->Answered(stroke);
      throw;
    }
    history->Answered(stroke);
  });
}

void Brush::Lift() { last_W_.reset(); }

void Brush::End() {
  Lift();
  failure_ = std::make_shared<std::exception_ptr>();
  ++stroke_;
}

std::function<void(const client::EditResult&)> Brush::OtherStroke(std::string name) {
  End();
  return [history = history_, stroke = stroke_++, connection = connection_,
          name = std::move(name)](const client::EditResult& result) {
    history->AddOther(stroke, name, connection, result);
  };
}

void Brush::Carved(std::uint64_t from_revision, std::uint64_t to_revision,
                   std::chrono::steady_clock::time_point begun, Commands& commands) {
  End();
  commands.Do("carving", [history = history_, stroke = stroke_++, connection = connection_,
                          from_revision, to_revision, begun](client::Client& client) {
    // What the stylus carves is nobody's change there.
    const std::chrono::duration<double> since = std::chrono::steady_clock::now() - begun;
    const double since_s = since.count() + kStale_s;
    const bool is_edited =
        std::ranges::any_of(client.GetActivity().changes, [&](const client::LastChange& change) {
          const bool is_of_voxels =
              change.what == "voxels" || change.what == "volume" || change.what == "series";
          return is_of_voxels && change.ago_s < since_s;
        });
    if (!is_edited) history->AddCarved(stroke, connection, from_revision, to_revision);
  });
}

bool Brush::is_waiting() const { return history_->is_waiting(); }

std::vector<Brush::BegunStroke> Brush::TakeBegun() { return history_->TakeBegun(); }

std::function<bool()> Brush::LastsOf(std::uint64_t number) const {
  return [history = history_, number] { return history->Lasts(number); };
}

void Brush::Restore(std::uint64_t number, bool forward, Commands& commands, ChangedBy changed_by) {
  commands.Do(
      forward ? "redo of a stroke" : "undo of a stroke",
      [history = history_, number, forward, changed_by = std::move(changed_by)](
          client::Client& client) { history->Restore(number, forward, client, changed_by); });
}

}  // namespace palpate::view
