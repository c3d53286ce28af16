// The view and its state. It takes the data from palpated, keeps camera, options and cross-hair,
// and draws the picture. Windows and panels read and change it.
//
// Frames: D device (mm), I voxels; pixels of the view from its upper left corner.
// Threads: that of the current OpenGL context. Errors: as LiveFeed and FrameRenderer, except for a
// volume that is too large: then the window and the emergency stop still work, and the next volume
// is shown.
#pragma once

#include <array>
#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "client/view/drawing/distances.h"
#include "client/view/palpated/brush.h"
#include "client/view/palpated/live_feed.h"
#include "client/view/palpated/panel_words.h"
#include "client/view/render/frame_renderer.h"
#include "client/view/viewer/escape.h"
#include "client/view/viewer/files.h"
#include "client/view/viewer/filter_form.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/options.h"
#include "client/view/viewer/pointer.h"
#include "client/view/viewer/preferences.h"
#include "client/view/viewer/tool_hand.h"
#include "client/view/viewer/tools.h"
#include "client/view/viewer/user_actions.h"

namespace palpate::view {

// The dialog of the connection.
struct ConnectForm {
  bool shown = false;
  std::vector<client::Profile> profiles{};
  std::string profiles_problem{};  // why there are no profiles
  client::ServerChoice typed{};
  std::string problem{};  // of the last attempt; empty: none
};

// A press of the button that is not a drag yet, while distances are measured.
struct MeasurePress {
  int picture = 0;
  Eigen::Vector2d at_px = Eigen::Vector2d::Zero();
  std::optional<DistanceEnd> end{};  // that it drags
  bool moved = false;
};

// The surface under the pointer, of that version of the surface.
struct PointedSurfaceState {
  Eigen::Vector2d at_px = Eigen::Vector2d::Zero();
  std::uint64_t version = 0;
  std::optional<Vec3> p_D{};
};

// The panel of recordings.
struct SessionState {
  std::string name = "trial";  // of the next recording
  std::string marker{};        // text of the next marker
  std::string chosen{};        // path of the recording in the list
  bool asked = false;          // for the list, at this connection
  RecordingWatch watch{};
  int markers = 0;                        // of the present recording, put from here
  std::optional<std::uint64_t> sought{};  // where the timeline is dragged to
};

// The answer to where the patient faces, as chosen so far: numbers of client::kWorldDirections.
struct FacingForm {
  std::uint64_t loaded_revision = 0;  // of the volume that it asks about
  int face = -1;                      // -1: not chosen
  int head = -1;
};

// Everything that the user sets.
struct ViewState {
  Camera camera;
  SurfaceOptions surface;  // isovalue and free side come from palpated
  OverlayOptions overlay;
  Tool tool = Tool::kTurn;
  HandOptions hand;
  BrushOptions brush;
  // Where the brush is on the surface under the pointer, in D; none: not chosen, or beside it.
  std::optional<Vec3> brush_at_D{};
  FilterForm filter{};
  // The point where the slices cross.
  bool cross_follows_proxy = false;
  Vec3 cross_I = Vec3::Zero();
  Vec3 cross_before_click_I = Vec3::Zero();  // a double click does not move it
  std::array<SliceZoom, 3> slice_zoom{};     // by axis of W
  std::optional<int> filling_slice{};        // the axis of the slice that fills the view's place
  std::optional<int> pointed_slice{};        // the axis of the slice under the pointer
  MeasureState measure{};
  std::optional<MeasurePress> measure_press{};
  PointedSurfaceState pointed_surface{};
  std::string view_name{};  // of the next saved view, as typed

  CutsState cuts{};
  // The pointer's path since the last frame, in pixels of the screen.
  std::vector<Eigen::Vector2d> pointer_way{};

  float screen_scale = 1.0f;  // of the layout, with the font size
  bool slices_shown = true;
  bool tab_wanted = true;  // the preferences' tab is to be opened
  // The role for which the headings on the right were opened or closed.
  std::optional<client::Role> headings_opened_for{};
  bool help_shown = false;
  EscapeRule escape{};
  Area stop_button{};             // a press there stops the forces, whatever is drawn over it
  bool stop_was_pressed = false;  // by the last press that a frame has shown
  FacingForm facing{};
  ConnectForm connect{};
  SessionState session{};
  // A tool that the user wants to take; the panel takes it, or asks about what is in its way.
  std::optional<HeldTool> wished_tool{};
  // Requested; done at the end of the frame.
  bool view_picture_wanted = false;
  bool window_picture_wanted = false;
};

class Viewer {
 public:
  explicit Viewer(const Options& options);

  // Connects to another palpated. Errors: as LiveFeed's; nothing has changed then.
  void Connect(const client::ServerChoice& server);
  // The palpated of the last Connect.
  const client::ServerChoice& server() const { return options_.server; }

  // Takes new data, and spends about `brick_time` on bricks that the last picture wants.
  void Update(std::chrono::milliseconds brick_time);
  // Uploads all bricks that the last picture wants. Returns false if the picture was whole.
  bool TakeUpWanted();
  // True if no part of the volume is missing, and stylus and settings are known.
  bool complete() const;
  // Why the volume cannot be drawn here; empty: it can.
  std::string volume_problem() const;
  // Why the picture is coarser than the volume; empty: it is not.
  std::string memory_problem() const;
  // Why the first volume cannot have the veil or the camera of the options; empty: it can, or none
  // is known.
  const std::string& option_problem() const { return option_problem_; }
  // Turns the camera as the options say.
  void Aim();

  // Draws into renderer().DrawnTexture(). If casts are slow, draws fewer pixels while things move,
  // and afterwards casts all pixels in parts over several frames, unless a picture of the view is
  // wanted.
  void Draw(const ImageSize& size);
  // Always draws all pixels and all bricks.
  void DrawFine(const ImageSize& size);
  // For pictures that are kept: always all pixels, and only of a complete volume.
  void AwaitWhole() {
    awaits_whole_ = true;
    feed_.AwaitWhole();
  }
  // Returns the surface under a point of the view, which has the size `size`, in D.
  std::optional<Vec3> SurfaceAt(const Eigen::Vector2d& at_px, const ImageSize& size) const;

  // Returns the whole surface of the last picture.
  SeenSurface seen_surface() const;
  // Returns the OpenGL name of the slice's texture. While the slices only follow the proxy, or
  // voxels change, each frame draws only one slice anew: three would cost more than the view.
  unsigned Slice(const SliceRequest& request);

  // Settings of palpated that the user is changing here: the user's value until palpated has it.
  HeldValues& held() { return held_; }
  static constexpr unsigned kIsovalueControl = 1;
  // The layers, as this user has just set them, or palpated's.
  SurfaceLayers ShownLayers() const;
  void SetLayers(const SurfaceLayers& layers);

  // As the options say, until the user chooses one in the window, which is remembered.
  SliceSide slice_side() const { return options_.slice_side.value_or(preferences_.slice_side); }
  void SetSliceSide(SliceSide side) {
    options_.slice_side.reset();
    preferences_.slice_side = side;
  }

  // Shows a line to the user for some seconds.
  void Say(const std::string& message);
  std::string message() const;

  ViewState& state() { return state_; }
  const ViewState& state() const { return state_; }
  // Defaults unless a window has read them. A window keeps changes.
  Preferences& preferences() { return preferences_; }
  const Preferences& preferences() const { return preferences_; }
  LiveFeed& feed() { return feed_; }
  const LiveFeed& feed() const { return feed_; }
  FrameRenderer& renderer() { return renderer_; }
  const FrameRenderer& renderer() const { return renderer_; }
  Brush& brush() { return brush_; }
  UserActions& actions() { return actions_; }
  PointerStroke& stroke() { return stroke_; }
  Files& files() { return files_; }
  const Files& files() const { return files_; }
  HandTool& hand() { return hand_; }
  const HandTool& hand() const { return hand_; }

 private:
  using Clock = std::chrono::steady_clock;

  // Everything that a cast depends on.
  struct Seen {
    ImageSize size;
    Camera camera;
    SurfaceOptions surface;
    std::uint64_t version = 0;
    friend bool operator==(const Seen&, const Seen&) = default;
  };
  // Everything that the wireframe of H depends on.
  struct Felt {
    Vec3i cell = Vec3i::Zero();
    double isovalue = 0.0;
    DecompositionMethod method{};
    int refinement = 1;
    std::uint64_t version = 0;
    double radius_voxels = 0.0;
    friend bool operator==(const Felt&, const Felt&) = default;
  };

  void TakeUpUntil(Clock::time_point end);
  bool TakeUpSome();
  void BeginVolumeIfNew();
  void ForgetActionsIfRestarted();
  void CheckOptions(const VolumeLattice& lattice);
  void FollowSettings();
  void FollowLayers();
  void FollowProxy();
  void UpdateHapticLines(const Vec3& p_I);
  // `view`: the size on the screen, for things whose size does not depend on the picture's pixels.
  void DrawAt(const ImageSize& size, const ImageSize& view);
  void AddTools(const ImageSize& view, Overlay& overlay) const;
  ImageSize CoarseSize(const ImageSize& size) const;
  std::optional<Bounds> VolumeBounds() const;
  std::optional<CameraStart> FirstLook() const;
  void AimInProfile();

  Options options_;
  LiveFeed feed_;
  FrameRenderer renderer_;
  Brush brush_;
  PointerStroke stroke_;
  HandTool hand_;
  ViewState state_;
  Preferences preferences_;
  std::optional<SurfaceLayers> own_layers_;  // until palpated has them
  Clock::time_point own_layers_until_{};
  HeldValues held_;
  UserActions actions_{feed_, brush_, state_.surface};
  std::uint64_t daemon_id_ = 0;  // 0: not known yet
  Files files_{*this};

  std::optional<VolumeLattice> begun_;  // the volume for which the view was set up
  bool aimed_ = false;
  bool aimed_at_whole_ = false;  // when no part of the volume was missing
  Camera aimed_camera_;          // that the last Aim has set
  std::string aimed_axes_;       // the patient's, then
  std::string option_problem_;
  bool bricks_left_ = true;
  std::string refused_;  // why the renderer refused the volume; empty: it did not
  Vec3i refused_size_ = Vec3i::Zero();

  struct DrawnSlice {
    SliceRequest request{};
    std::uint64_t version = 0;  // of the renderer's volume
    unsigned texture = 0;       // 0: not drawn yet
  };
  std::array<DrawnSlice, 3> slices_;
  std::uint64_t frame_ = 0;

  std::optional<Felt> felt_;
  HeldTool tool_;  // that is felt
  bool tool_is_replayed_ = false;
  std::vector<Vec3> haptic_lines_I_;

  std::optional<Seen> seen_;
  Clock::time_point changed_at_{};
  ImageSize drawn_size_;
  ImageSize drawn_for_;  // the size of the view then
  Camera drawn_camera_;
  bool awaits_whole_ = false;
  bool had_overview_ = false;
  double last_cast_ms_ = 0.0;  // of a cast with all pixels

  std::string message_;
  Clock::time_point message_until_{};
};

}  // namespace palpate::view
