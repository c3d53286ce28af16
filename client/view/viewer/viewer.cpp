#include "client/view/viewer/viewer.h"

#include <epoxy/gl.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "client/view/drawing/haptic_patch.h"
#include "client/view/drawing/overlay.h"
#include "client/view/drawing/readout.h"
#include "client/view/drawing/surface_bounds.h"
#include "client/view/drawing/value_window.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/isosurface/sub_cell.h"

namespace palpate::view {
namespace {

// Bricks per step. The clock is checked between the steps.
constexpr std::size_t kBricksAtOnce = 512;
// The user feels casts above this time while the camera moves.
constexpr double kSlowCast_ms = 40.0;
// A cast while things move takes about this time, with fewer pixels if need be.
constexpr double kCoarseCast_ms = 70.0;
constexpr double kMostPixelsPerCoarsePixel = 36.0;
// Of an unknown volume, until the first cast.
constexpr double kUnknownCast_ms = 1000.0;
// Of each frame, for the parts of a cast with all pixels.
constexpr std::chrono::milliseconds kPartTime(70);
// After this time without motion, draw all pixels.
constexpr std::chrono::milliseconds kStill(250);
constexpr std::chrono::seconds kMessageTime(5);

bool SameVolume(const VolumeLattice& a, const VolumeLattice& b) {
  return a.source == b.source && a.size == b.size && a.spacing_mm == b.spacing_mm &&
         a.value_min == b.value_min && a.value_max == b.value_max;
}

// Limits the size to what this OpenGL can draw, with the same shape.
ImageSize Drawable(const ImageSize& size) {
  static const int most = [] {
    GLint texture = 0;
    std::array<GLint, 2> viewport{};
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &texture);
    glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport.data());
    return std::min({texture, viewport[0], viewport[1]});
  }();
  const int longest = std::max(size.width, size.height);
  if (longest <= most) return size;
  const double share = static_cast<double>(most) / longest;
  return {std::max(1, static_cast<int>(share * size.width)),
          std::max(1, static_cast<int>(share * size.height))};
}

double Share(const ImageSize& part, const ImageSize& whole) {
  return static_cast<double>(part.width) * part.height /
         (static_cast<double>(whole.width) * whole.height);
}

}  // namespace

Viewer::Viewer(const Options& options)
    : options_(options),
      feed_(options.server),
      renderer_(static_cast<std::size_t>(options.graphics_memory_mib) << 20) {
  state_.surface = options.surface;
  state_.overlay = options.overlay;
}

void Viewer::Connect(const client::ServerChoice& server) {
  const auto running = feed_.loader().running();
  feed_.Connect(server);
  options_.server = server;
  stroke_.BreakOff();
  actions_.Forget();
  files_.ForgetServer();
  state_.session = {.name = state_.session.name};
  if (running) Say(running->what + " was given up: another connection was made");
}

void Viewer::Update(std::chrono::milliseconds brick_time) {
  feed_.Poll();
  brush_.Follow(feed_.volume(), feed_.losses());
  if (feed_.connection().state != client::ConnectionState::kConnected) stroke_.BreakOff();
  ForgetActionsIfRestarted();
  files_.Follow();
  BeginVolumeIfNew();
  // The overview fills what was empty: until the first cast, nobody knows what one costs.
  const bool has_overview = feed_.volume().has_overview();
  if (has_overview && !had_overview_) last_cast_ms_ = kUnknownCast_ms;
  had_overview_ = has_overview;
  TakeUpUntil(Clock::now() + brick_time);
  FollowSettings();
  FollowProxy();
}

void Viewer::ForgetActionsIfRestarted() {
  const auto& revision = feed_.volume().revision();
  if (!revision || revision->daemon_id == daemon_id_) return;
  if (daemon_id_ != 0) actions_.Forget();
  daemon_id_ = revision->daemon_id;
}

bool Viewer::complete() const {
  // Counts the volume that was received, because the daemon's volume may be newer.
  const bool whole = begun_ && feed_.volume().bricks_left() == 0 && !bricks_left_;
  return feed_.connection().state == client::ConnectionState::kConnected && whole && aimed_ &&
         volume_problem().empty() && feed_.pose() && feed_.settings();
}

std::string Viewer::memory_problem() const {
  if (!renderer_.is_full()) return {};
  return fmt::format(
      "coarser where far, small parts may be missing: {} MiB of graphics memory are full "
      "(--graphics-memory-mib)",
      options_.graphics_memory_mib);
}

std::string Viewer::volume_problem() const {
  const auto& lattice = feed_.volume().lattice();
  return lattice && lattice->size == refused_size_ ? refused_ : std::string();
}

void Viewer::TakeUpUntil(Clock::time_point end) {
  do {
    bricks_left_ = !TakeUpSome();
  } while (bricks_left_ && Clock::now() < end);
}

bool Viewer::TakeUpWanted() {
  const std::uint64_t before = renderer_.volume_version();
  TakeUpUntil(Clock::time_point::max());
  return renderer_.volume_version() != before;
}

// Returns true if no brick is left.
bool Viewer::TakeUpSome() {
  try {
    return renderer_.TakeUp(feed_.volume(), kBricksAtOnce);
  } catch (const Error& error) {
    // Thrown once. The renderer then has no volume.
    if (error.kind() != ErrorKind::kTooLarge) throw;
    refused_ = error.what();
    refused_size_ = feed_.volume().lattice()->size;
    return true;
  }
}

void Viewer::BeginVolumeIfNew() {
  const ViewVolume& volume = feed_.volume();
  if (!volume.lattice() || !volume.X_DI()) return;
  const VolumeLattice& lattice = *volume.lattice();
  // The same volume again, as after a reconnection, keeps the view.
  if (begun_ && SameVolume(*begun_, lattice)) return;
  SurfaceOptions& surface = state_.surface;
  const double range = lattice.value_max - lattice.value_min;
  const ValueWindow window = FirstWindow(lattice);
  if (!begun_) CheckOptions(lattice);
  surface.window_min = options_.window ? options_.window->x() : window.min();
  surface.window_max = options_.window ? options_.window->y() : window.max();
  if (begun_ || !options_.surface.veil.shown) {
    surface.veil.shown = false;
    surface.veil.isovalue = lattice.value_min + 0.25 * range;
  }
  if (begun_) {
    surface.crop = {};
    for (ClipPlane& plane : surface.planes) plane = {};
  }
  stroke_.BreakOff();
  state_.slice_zoom = {};
  state_.filling_slice.reset();
  state_.measure.Clear();
  const Vec3 middle_I = 0.5 * (lattice.size.cast<double>() - Vec3::Ones());
  state_.cuts = {};
  state_.cuts.pivots_I.fill(middle_I);
  state_.brush.value = 0.5 * range;
  state_.cross_I = middle_I;
  begun_ = lattice;
  actions_.Forget();
  last_cast_ms_ = kUnknownCast_ms;
  aimed_at_whole_ = false;
  Aim();
}

// The first volume says whether it can have the veil and the camera of the options.
void Viewer::CheckOptions(const VolumeLattice& lattice) {
  Veil& veil = options_.surface.veil;
  if (veil.shown && !(veil.isovalue >= lattice.value_min && veil.isovalue <= lattice.value_max)) {
    veil.shown = false;
    option_problem_ = fmt::format("--veil {} is not within {} to {}, the volume's range",
                                  NumberText(veil.isovalue), NumberText(lattice.value_min),
                                  NumberText(lattice.value_max));
    Say(option_problem_ + ": the veil is not shown");
  }
  if (options_.camera && options_.camera->of_patient && !PatientFrameOf(feed_.volume()).is_known) {
    const std::string problem =
        "--camera names a side of the patient, and the file states no orientation: answer where "
        "the patient faces ('palpate place --face=-y --head=+z')";
    if (option_problem_.empty()) option_problem_ = problem;
    Say(problem);
  }
}

// Those of the surface, if it is known: the box of a scan may have much air. A camera of the
// options sees the box, for pictures that can be compared.
std::optional<Bounds> Viewer::VolumeBounds() const {
  const ViewVolume& volume = feed_.volume();
  if (feed_.settings() && volume.bricks_left() == 0 && !options_.camera) {
    const std::vector<SurfaceLayer>& layers = feed_.settings()->layers.layer;
    const double outermost = layers.empty() ? feed_.settings()->isovalue : layers.front().isovalue;
    if (const auto bounds = SurfaceBounds(volume, outermost)) return bounds;
  }
  if (!volume.lattice() || !volume.X_DI()) return {};
  const Vec3 last_I = volume.lattice()->size.cast<double>() - Vec3::Ones();
  return BoundsOf(*volume.X_DI(), Vec3::Zero(), last_I);
}

// None: the camera's own.
std::optional<CameraStart> Viewer::FirstLook() const {
  const bool is_known = PatientFrameOf(feed_.volume()).is_known;
  if (options_.camera && (is_known || !options_.camera->of_patient)) return options_.camera;
  if (!is_known) return {};
  return CameraStart{.of_patient = true, .azimuth_deg = 20.0, .elevation_deg = 10.0};
}

void Viewer::Aim() {
  const std::optional<Bounds> bounds = VolumeBounds();
  if (!bounds) return;
  Camera& camera = state_.camera;
  camera.Reset(*bounds);
  const std::optional<CameraStart> start = FirstLook();
  if (start && !start->in_profile) {
    const ViewVolume& volume = feed_.volume();
    if (start->of_patient) {
      camera.SetUpright(UprightPatient(volume.X_DI()->linear, PatientFrameOf(volume).X_PI.linear));
    }
    camera.Set(camera.target(), start->azimuth_deg, start->elevation_deg,
               start->distance_mm.value_or(camera.distance_mm()));
    if (!start->distance_mm) camera.Fit(*bounds);
  }
  aimed_ = true;
  aimed_axes_ = feed_.volume().patient_axes();
  if (options_.target == TargetStart::kPoint) camera.LookAt(options_.target_D);
  if (options_.target == TargetStart::kProxy) {
    if (feed_.pose()) camera.LookAt(feed_.pose()->scp_h_mm);
    aimed_ = feed_.pose().has_value();
  }
  if (options_.camera && options_.camera->in_profile && aimed_) AimInProfile();
  aimed_camera_ = camera;
}

// A little above the surface, because the surface may curve up on the way.
void Viewer::AimInProfile() {
  const client::Pose& pose = *feed_.pose();
  const Vec3 normal = pose.scp_h_normal.value_or(Vec3::UnitY());
  const Vec3 aside = normal.unitOrthogonal();
  const Vec3 to_eye = (aside + 0.3 * normal).normalized();
  state_.camera.Set(pose.scp_h_mm, std::atan2(to_eye.x(), to_eye.z()) * 180.0 / std::numbers::pi,
                    std::asin(to_eye.y()) * 180.0 / std::numbers::pi,
                    *options_.camera->distance_mm);
}

void Viewer::FollowSettings() {
  if (!aimed_) Aim();
  if (!feed_.settings()) return;
  if (aimed_ && !aimed_at_whole_ && feed_.volume().bricks_left() == 0) {
    // The surface is known now. A user who has turned the view meanwhile keeps it.
    aimed_at_whole_ = true;
    if (state_.camera == aimed_camera_) Aim();
  }
  // Somebody has answered where the patient faces.
  if (aimed_ && aimed_axes_ != feed_.volume().patient_axes() && state_.camera == aimed_camera_)
    Aim();
  // What is shown in a replay was never set here.
  if (feed_.settings()->replayed) own_layers_.reset();
  state_.surface.isovalue = feed_.settings()->replayed
                                ? feed_.settings()->isovalue
                                : held_.Shown(kIsovalueControl, feed_.settings()->isovalue);
  state_.surface.free_above = feed_.settings()->free_side == client::FreeSide::kAbove;
  FollowLayers();
}

// The innermost layer is drawn as the surface, the others as veils.
void Viewer::FollowLayers() {
  if (own_layers_) {
    const SurfaceLayers& told = feed_.settings()->layers;
    for (SurfaceLayer& layer : own_layers_->layer) {
      const auto same = std::ranges::find(told.layer, layer.name, &SurfaceLayer::name);
      if (layer.id == 0 && same != told.layer.end()) layer.id = same->id;
    }
    if (own_layers_ == told || Clock::now() > own_layers_until_) own_layers_.reset();
  }
  state_.surface.layers.clear();
  for (const SurfaceLayer& layer : ShownLayers().layer) {
    state_.surface.layers.push_back({layer.isovalue, LayerColor(static_cast<int>(layer.id))});
  }
  if (state_.surface.layers.empty()) return;
  state_.surface.isovalue = state_.surface.layers.back().isovalue;
}

SurfaceLayers Viewer::ShownLayers() const {
  if (own_layers_) return *own_layers_;
  return feed_.settings() ? feed_.settings()->layers : SurfaceLayers();
}

void Viewer::SetLayers(const SurfaceLayers& layers) {
  own_layers_ = layers;
  std::ranges::stable_sort(own_layers_->layer, {}, &SurfaceLayer::isovalue);
  own_layers_until_ = Clock::now() + HeldValues::kPatience;
  feed_.shared().NoteOwn("layers");
  feed_.commands().Set({.layers = layers});
}

void Viewer::FollowProxy() {
  const ViewVolume& volume = feed_.volume();
  if (!feed_.pose() || !volume.lattice() || !volume.X_DI()) return;
  const Vec3 p_I = volume.X_DI()->Inverse().Apply(feed_.pose()->scp_h_mm);
  if (state_.cross_follows_proxy) {
    const Vec3 last_I = volume.lattice()->size.cast<double>() - Vec3::Ones();
    state_.cross_I = p_I.cwiseMax(Vec3::Zero()).cwiseMin(last_I);
  }
  UpdateHapticLines(p_I);
}

void Viewer::UpdateHapticLines(const Vec3& p_I) {
  // A ball feels H of another field.
  if (!state_.overlay.haptic_surface || !feed_.settings() || feed_.pose()->tool_radius_mm > 0.0) {
    haptic_lines_I_.clear();
    felt_.reset();
    return;
  }
  const ViewVolume& volume = feed_.volume();
  const Felt felt{
      .cell = p_I.array().floor().cast<int>(),
      // With layers that of the one in contact, or of the next one.
      .isovalue = feed_.settings()->layers.layer.empty() ? feed_.settings()->isovalue
                                                         : feed_.pose()->isovalue,
      .method = feed_.settings()->method,
      // The one in use. A daemon that does not know it has 1.
      .refinement = std::clamp(static_cast<int>(feed_.pose()->refinement), 1, kMaxRefinement),
      .version = volume.version(),
      .radius_voxels = state_.overlay.haptic_surface_radius_voxels};
  if (felt_ == felt) return;
  felt_ = felt;
  const Vec3 center_I = felt.cell.cast<double>() + Vec3::Constant(0.5);
  haptic_lines_I_ = HapticPatch(volume, felt.isovalue, felt.method, felt.refinement, center_I,
                                felt.radius_voxels);
}

void Viewer::Draw(const ImageSize& size) {
  ++frame_;
  const Seen seen{.size = size,
                  .camera = state_.camera,
                  .surface = state_.surface,
                  .version = feed_.volume().version()};
  const bool changed = seen_ != seen;
  if (changed) {
    // The first picture of a view does not count as motion.
    if (seen_) changed_at_ = Clock::now();
    seen_ = seen;
  }
  if (!state_.slices_shown) renderer_.ForgetSlices();
  if (state_.window_picture_wanted) {
    DrawFine(size);
    return;
  }
  const ImageSize all = Drawable(size);
  if (awaits_whole_ || last_cast_ms_ <= kSlowCast_ms) {
    DrawAt(all, size);
    return;
  }
  const bool moving = Clock::now() - changed_at_ < kStill;
  const FrameRequest fine = {.size = all, .camera = state_.camera, .surface = state_.surface};
  if (!moving && renderer_.Prepare(fine, kPartTime)) {
    DrawAt(all, size);
  } else {
    // Without a change the coarse picture stays: another size would be another cast.
    DrawAt(changed || drawn_for_ != size ? CoarseSize(all) : drawn_size_, size);
  }
}

// The size at which a cast is quick enough.
ImageSize Viewer::CoarseSize(const ImageSize& size) const {
  const double pixels = std::clamp(last_cast_ms_ / kCoarseCast_ms, 4.0, kMostPixelsPerCoarsePixel);
  const double edge = std::sqrt(pixels);
  return {std::max(1, static_cast<int>(size.width / edge)),
          std::max(1, static_cast<int>(size.height / edge))};
}

void Viewer::DrawFine(const ImageSize& size) {
  do {
    DrawAt(Drawable(size), size);
  } while (TakeUpWanted());
}

void Viewer::DrawAt(const ImageSize& size, const ImageSize& view) {
  OverlayScene scene{.pose = feed_.pose(), .haptic_lines_I = haptic_lines_I_};
  const ViewVolume& volume = feed_.volume();
  scene.X_DI = volume.X_DI();
  if (volume.lattice()) {
    scene.lattice_size = volume.lattice()->size;
    const PatientFrame frame = PatientFrameOf(volume);
    if (frame.is_known) scene.P_from_I = frame.X_PI.linear;
  }
  if (const client::Hand* device = feed_.device(); device && device->device.max_force_n > 0.0) {
    scene.max_force_n = device->device.max_force_n;
    scene.max_torque_n_mm = device->device.max_torque_n_mm;
  }
  // While another one is made, that of before is felt.
  if (const auto& settings = feed_.settings()) {
    const bool is_other =
        std::exchange(tool_is_replayed_, settings->replayed) != settings->replayed;
    if (is_other || !settings->ball.is_awaited) tool_ = settings->tool;
  }
  scene.tool = tool_;
  scene.hand_target_D = hand_.target_D();
  Overlay overlay = BuildOverlay(scene, state_.overlay, state_.camera, view);
  AddTools(view, overlay);
  const std::uint64_t casts = renderer_.casts();
  const auto begin = Clock::now();
  renderer_.Draw(
      {.size = size, .camera = state_.camera, .surface = state_.surface, .overlay = &overlay});
  drawn_size_ = size;
  drawn_for_ = view;
  drawn_camera_ = state_.camera;
  if (renderer_.casts() == casts) return;
  glFinish();
  last_cast_ms_ =
      std::chrono::duration<double, std::milli>(Clock::now() - begin).count() / Share(size, view);
}

// The cuts with their handles, and the brush.
void Viewer::AddTools(const ImageSize& view, Overlay& overlay) const {
  const Projection projection(state_.camera, view);
  if (const std::optional<CutScene> cuts = CutSceneOf(*this)) {
    const CropBox whole;
    if (state_.cuts.in_use || (state_.overlay.box && cuts->cuts.crop != whole)) {
      AddCropBox(*cuts, overlay);
    }
    if (state_.cuts.in_use) AddCutHandles(*cuts, LitHandle(state_.cuts), projection, overlay);
  }
  // Last: it is translucent, and what is within it is to be seen.
  if (state_.brush_at_D) {
    const double scale = DeviceMmPerMm(feed_.volume());
    AddBrushBall(*state_.brush_at_D, scale * state_.brush.radius_mm,
                 scale * state_.brush.falloff_mm, projection, overlay);
  }
}

std::optional<Vec3> Viewer::SurfaceAt(const Eigen::Vector2d& at_px, const ImageSize& size) const {
  const int x = static_cast<int>(std::floor(at_px.x() * drawn_size_.width / size.width));
  const int y = static_cast<int>(std::floor(at_px.y() * drawn_size_.height / size.height));
  if (x < 0 || y < 0 || x >= drawn_size_.width || y >= drawn_size_.height) return {};
  return renderer_.SurfaceAt(x, y);
}

SeenSurface Viewer::seen_surface() const {
  return {
      .size = drawn_size_, .camera = drawn_camera_, .distances_mm = renderer_.SurfaceDistances()};
}

unsigned Viewer::Slice(const SliceRequest& request) {
  const std::uint64_t version = renderer_.volume_version();
  DrawnSlice& drawn = slices_[static_cast<std::size_t>(request.picture)];
  SliceRequest moved = drawn.request;
  moved.position_voxels = request.position_voxels;
  moved.cross_I = request.cross_I;
  const bool same_but_place = drawn.texture != 0 && moved == request;
  const bool same_voxels = drawn.version == version;
  if (same_but_place && same_voxels && drawn.request == request) return drawn.texture;
  const bool its_turn = frame_ % slices_.size() == static_cast<std::size_t>(request.picture);
  const bool may_wait = !awaits_whole_ && !state_.window_picture_wanted &&
                        (state_.cross_follows_proxy || !same_voxels);
  if (same_but_place && may_wait && !its_turn) return drawn.texture;
  drawn = {.request = request, .version = version, .texture = renderer_.DrawSlice(request)};
  return drawn.texture;
}

void Viewer::Say(const std::string& message) {
  message_ = message;
  message_until_ = Clock::now() + kMessageTime;
}

std::string Viewer::message() const {
  return Clock::now() < message_until_ ? message_ : std::string();
}

}  // namespace palpate::view
