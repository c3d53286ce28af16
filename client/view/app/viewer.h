// The view and what it shows: takes up what comes from palpated, keeps camera, options
// and cross-hair, and has the picture drawn. Windows and panels read and change it.
//
// Frames: D device (mm), I voxels; pixels of the view from its upper left corner.
// Threads: that of the current OpenGL context. Errors: as LiveFeed and FrameRenderer, but
// for volumes that are too large: window and emergency stop go on, and the next one comes.
#pragma once

#include <array>
#include <chrono>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "client/view/app/held_values.h"
#include "client/view/app/options.h"
#include "client/view/app/pointer_stroke.h"
#include "client/view/live/brush.h"
#include "client/view/live/live_feed.h"
#include "client/view/render/frame_renderer.h"

namespace palpate::view {

// The dialog of the connection.
struct ConnectForm {
  bool shown = false;
  std::vector<client::Profile> profiles{};
  std::string profiles_problem{};  // why there are none
  client::ServerChoice typed{};
  std::string problem{};  // of the last attempt; empty: none
};

// What the user sets.
struct ViewState {
  Camera camera;
  SurfaceOptions surface;  // isovalue and free side are palpated's
  OverlayOptions overlay;
  BrushOptions brush;
  client::Filter denoise{};
  // Where the slices cross.
  bool cross_follows_proxy = true;
  Vec3 cross_I = Vec3::Zero();

  // Planes that were put somewhere: their offsets mean something.
  std::array<bool, std::tuple_size_v<decltype(SurfaceOptions::planes)>> planes_placed{};
  // The pointer's way since the frame before, pixels of the screen.
  std::vector<Eigen::Vector2d> pointer_way{};

  bool panels_shown = true;
  bool slices_shown = true;
  bool help_shown = false;
  ConnectForm connect{};
  std::string recording_path{};  // on the daemon's machine
  // Wanted, and fulfilled at the end of the frame.
  bool view_picture_wanted = false;
  bool window_picture_wanted = false;
};

class Viewer {
 public:
  explicit Viewer(const Options& options);

  // To another palpated. Errors: as LiveFeed's, and nothing has changed.
  void Connect(const client::ServerChoice& server);
  // The one that it was told last.
  const client::ServerChoice& server() const { return options_.server; }

  // Takes up what came, and spends about so long on bricks of the volume.
  void Update(std::chrono::milliseconds brick_time);
  // Nothing of the volume is missing, and stylus and settings are known.
  bool complete() const;
  // Why the volume cannot be drawn here; empty: it can.
  std::string volume_problem() const;
  // Turns the camera to where the options want it.
  void Aim();

  // Into renderer().DrawnTexture(). May draw fewer pixels while things move, where a
  // cast takes long and no picture of it is wanted.
  void Draw(const ImageSize& size);
  // All of them, always.
  void DrawFine(const ImageSize& size);
  void AllowCoarse(bool allowed) { coarse_allowed_ = allowed; }
  // The surface under a point of the view of that size, in D.
  std::optional<Vec3> SurfaceAt(double x_px, double y_px, const ImageSize& size) const;

  // All of it, as in the last picture.
  SeenSurface seen_surface() const;
  // The name of its texture. While the slices only follow the proxy, one of them is drawn
  // anew in each frame, for three would cost more than the view.
  unsigned Slice(const SliceRequest& request);

  // Settings of palpated that are changed here: the user's until palpated has them.
  HeldValues& held() { return held_; }
  static constexpr unsigned kIsovalueControl = 1;

  // A line for the user, shown for some seconds.
  void Say(const std::string& message);
  std::string message() const;

  ViewState& state() { return state_; }
  const ViewState& state() const { return state_; }
  LiveFeed& feed() { return feed_; }
  const LiveFeed& feed() const { return feed_; }
  FrameRenderer& renderer() { return renderer_; }
  const FrameRenderer& renderer() const { return renderer_; }
  Brush& brush() { return brush_; }
  PointerStroke& stroke() { return stroke_; }
  double last_cast_ms() const { return last_cast_ms_; }

 private:
  using Clock = std::chrono::steady_clock;

  // What a cast depends on.
  struct Seen {
    ImageSize size;
    Camera camera;
    SurfaceOptions surface;
    std::uint64_t version = 0;
    friend bool operator==(const Seen&, const Seen&) = default;
  };
  // What the wireframe of H depends on.
  struct Felt {
    Vec3i cell = Vec3i::Zero();
    double isovalue = 0.0;
    DecompositionMethod method{};
    std::uint64_t version = 0;
    double radius_voxels = 0.0;
    friend bool operator==(const Felt&, const Felt&) = default;
  };

  void TakeUp(std::chrono::milliseconds brick_time);
  bool TakeUpSome();
  void BeginVolumeIfNew();
  void FollowSettings();
  void FollowProxy();
  void UpdateHapticLines(const Vec3& p_I);
  // `view`: the size on the screen, for what does not change with the picture's pixels.
  void DrawAt(const ImageSize& size, const ImageSize& view);
  std::optional<Bounds> VolumeBounds() const;
  void AimInProfile();

  Options options_;
  LiveFeed feed_;
  FrameRenderer renderer_;
  Brush brush_;
  PointerStroke stroke_;
  ViewState state_;
  HeldValues held_;

  std::optional<VolumeLattice> begun_;  // the volume that the view was set up for
  bool aimed_ = false;
  bool bricks_left_ = true;
  std::string refused_;  // why, of the volume that the renderer did not take
  Vec3i refused_size_ = Vec3i::Zero();

  struct DrawnSlice {
    SliceRequest request{};
    std::uint64_t version = 0;
    unsigned texture = 0;  // 0: not drawn yet
  };
  std::array<DrawnSlice, 3> slices_;
  // Rises with whatever changes what the renderer has of the volume.
  std::uint64_t taken_version_ = 0;
  std::uint64_t volume_version_ = 0;
  std::optional<AffineMap> taken_X_DI_;
  std::uint64_t frame_ = 0;

  std::optional<Felt> felt_;
  std::vector<Vec3> haptic_lines_I_;

  std::optional<Seen> seen_;
  Clock::time_point changed_at_{};
  ImageSize drawn_size_;
  Camera drawn_camera_;
  bool coarse_allowed_ = true;
  double last_cast_ms_ = 0.0;  // of all pixels

  std::string message_;
  Clock::time_point message_until_{};
};

}  // namespace palpate::view
