// All calls that palpated offers. Each waits for the answer.
//
//   palpate::client::Calls palpated;   // $PALPATE_SERVER, or the socket of this machine
//   palpated.LoadVolume("/data/head.nrrd", {.isovalue = 300.0});
//   auto saved = palpated.Async([](auto& p) { return p.SaveVolume("/data/edited.vdb"); });
//   palpated.Apply({.shape = palpate::client::Sphere{{12, -3, 40}, 5.0}, .value = -300.0});
//   std::printf("revision %llu\n", saved.get().volume_revision);
//
// Client adds what follows the daemon by itself: poses, settings, a copy of the volume.
//
// Paths are absolute and on the daemon's machine, unless stated otherwise.
// Threads: call all methods from any thread, also at the same time. Calls must outlive every
// PoseReader, HandLead and future that it returned.
// Errors: Error (common/error/error.h) with the daemon's own text. Any method may throw
//   kUnavailable       palpated is not reached, went away, or did not answer within 5 s
//   kPermissionDenied  our role does not allow the call
//   kCancelled         a ProgressFunction or EndCalls cancelled the call
// and the errors that the method names.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "client/sdk/activity.h"
#include "client/sdk/device.h"
#include "client/sdk/download.h"
#include "client/sdk/edit.h"
#include "client/sdk/hand_lead.h"
#include "client/sdk/placement.h"
#include "client/sdk/pose_reader.h"
#include "client/sdk/progress.h"
#include "client/sdk/recording.h"
#include "client/sdk/series.h"
#include "client/sdk/server_choice.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"
#include "common/error/error.h"

namespace palpate::client {

class Link;

class Calls {
 public:
  // Does not connect; the first call does. Errors: kInvalidArgument (unusable address or
  // credentials), kNotFound (a file of the credentials), kPermissionDenied (others may write to the
  // socket's folder).
  explicit Calls(const Server& server = Resolve({}));
  virtual ~Calls();
  Calls(const Calls&) = delete;
  Calls& operator=(const Calls&) = delete;

  // Silences the transport's log unless the environment asks for the log. For programs that print
  // errors as lines of their own. Call it on main, before anything else.
  static void SilenceTransport();

  // "unix:/run/palpate/palpated.sock" or "localhost:7400", for people.
  std::string name() const;
  // True if palpated is reached by a socket of this machine. Pose::time_ns is then a time of
  // steady_clock. False over TCP: the machine is not known.
  bool shares_clock() const;
  // Throws an Error that says why palpated is not reached within `timeout`, and what to do. On
  // this machine, waits up to 2 s for a palpated that is just being started.
  void WaitUntilReached(std::chrono::milliseconds timeout);
  // While palpated loads its first volume, calls that need one wait. `call` gets a line for people
  // five times a second, such as "loading head.nrrd, 40 %", on the thread of the call that waits.
  // If it returns false, that call fails with kLoading. Once the call goes on, it gets "". Set it
  // before the first call.
  void SetOnLoading(std::function<bool(const std::string& line)> call);
  // Ends running calls of all threads with kCancelled. Later calls fail at once with kCancelled.
  void EndCalls();

  // Runs work(*this) on a thread of its own. The future's destructor waits for it.
  template <class Work>
  std::future<std::invoke_result_t<Work, Calls&>> Async(Work work) {
    return std::async(std::launch::async,
                      [this, held = std::move(work)]() mutable { return held(*this); });
  }

  // `rate_hz`: samples per second of loop time, in (0, 1000]. `batch`: samples in a message, 1 to
  // 256.
  PoseReader ReadPoses(double rate_hz, std::uint32_t batch);

  // --- What is felt
  virtual Settings GetSettings();
  // Returns when the servo has used the settings. Errors: kInvalidArgument (out of range, or
  // nothing to change), kConflict (expected_revision).
  virtual SettingsResult Set(const SettingsUpdate& update);
  PlacementNow GetPlacement();
  // Returns when the servo has used the placement. Errors: kInvalidArgument (not finite, a scale
  // out of range, not a rotation, not a direction), kFailedPrecondition (a facing of a file that
  // states its orientation), kConflict (expected_revision).
  PlacementResult Place(const PlacementChange& change);

  // --- Volumes
  VolumeInfo GetVolume();
  // `source`: a file or DICOM folder, or "builtin:NAME[:N]". The previous volume stays until the
  // new one is complete, and also if the load fails. Errors: kInvalidArgument (no volume, a bad
  // option), kNotFound, kTooLarge, kConflict (another load runs), kCancelled.
  LoadResult LoadVolume(const std::string& source, const LoadOptions& options = {},
                        const ProgressFunction& progress = {});
  // Like LoadVolume, with a file of this machine: any one-file format that LoadVolume reads, or a
  // folder of DICOM or TIFF files.
  LoadResult UploadVolume(const std::filesystem::path& file, const LoadOptions& options = {},
                          const ProgressFunction& progress = {});
  // Returns a copy of the voxels as they are now, in their own type.
  DownloadResult DownloadVolume(const ProgressFunction& progress = {});
  // The suffix of `path` selects the format: .vdb or .nrrd. After an error the old file is
  // unchanged. Errors: kConflict (the file exists and `overwrite` is false, or another save runs),
  // kNotFound (no such folder), kDiskFull.
  SaveResult SaveVolume(const std::string& path, bool overwrite = false,
                        const ProgressFunction& progress = {});

  // --- Edits
  // Returns when the servo has used the edit. Errors: see volume.proto; kConflict for a wrong
  // revision and for nothing to undo or redo. `progress`: called for more than 16 777 216 voxels
  // only; such an edit takes seconds, and other edits wait.
  EditResult Apply(const Edit& edit, const ProgressFunction& progress = {});
  // Other clients can edit while the filter runs. Errors: also kConflict if another filter runs.
  EditResult RunFilter(const Filter& filter, const ProgressFunction& progress = {});
  // `expected_revision`: fails with kConflict unless the volume is at this revision. So the call
  // never undoes a change of another client.
  EditResult Undo(std::optional<std::uint64_t> expected_revision = {});
  EditResult Redo(std::optional<std::uint64_t> expected_revision = {});
  // Restores the volume as it was loaded, as one edit.
  EditResult Revert(std::optional<std::uint64_t> expected_revision = {});

  // --- Time series
  // `sources`: files of one frame each, in the order of time, or one file with several frames. A
  // name may be a pattern with * and ?. Errors: as LoadVolume.
  SeriesResult LoadSeries(const std::vector<std::string>& sources, const LoadOptions& options = {},
                          const ProgressFunction& progress = {});
  // Errors: kConflict if no series is loaded. ControlSeries returns when the servo has used the
  // frame.
  SeriesState GetSeries();
  SeriesControlled ControlSeries(const SeriesControl& control);

  // --- Device and forces
  DaemonInfo GetDevice();
  std::vector<ListedDevice> ListDevices();
  // `device`: its configuration name. May be empty if the device's forces are verified or the
  // device is simulated. Errors: kFailedPrecondition; the text says what keeps the forces off.
  ForceResult EnableForces(const std::string& device = {});
  // Ramps the forces down to zero. They stay off until they are enabled again.
  ForceResult DisableForces();
  // Emergency stop: zero force within one tick, until forces are enabled again. Where
  // palpated is reached by its socket, by another socket for that alone; over TCP on a connection
  // for that alone.
  ForceResult StopForces();
  // Calibrates the device in its place of rest, when the stylus is docked next; some devices by
  // moving their arm. `device`: its configuration name, needed if its arm moves. Errors:
  // kInvalidArgument (the device has no calibration, or is not named), kFailedPrecondition (it is
  // not there, or its forces are on).
  DeviceHealth CalibrateDevice(const std::string& device = {});
  // Puts a force of at most 0.5 N on the hand for at most 5 s, to try the motors. Returns the first
  // tick with it. Of any 10 s, pushes of all clients together take at most 5 s. Errors:
  // kInvalidArgument, kTooLarge (they have taken that), kFailedPrecondition (the forces do not
  // act).
  std::uint64_t PushHand(const Vec3& force_n, double seconds);
  // Leads the hand of the simulated device. Returns at once, and does not connect: see HandLead.
  std::unique_ptr<HandLead> LeadHand();

  // Who is connected, and who changed what.
  Activity GetActivity();
  // Ends all calls of an identity, such as "token ada". Returns how many ran.
  unsigned EndCaller(const std::string& identity);

  // --- Recordings. Errors: as in recording.proto.
  RecordingState StartRecording(const std::string& path, bool overwrite = false);
  RecordingState StopRecording();
  RecordingState GetRecording();
  // Adds a marker to the recording. Returns the marker's time, on the clock of Pose::time_ns.
  std::int64_t Mark(const std::string& text);
  // Plays a recording to all clients that follow the poses, with forces off. Returns the last
  // state.
  ReplayState Replay(const std::string& path, const ReplayOptions& options = {},
                     const ReplayFunction& progress = {});
  // The recordings in the folders that the daemon saves to.
  RecordingList ListRecordings();

 protected:
  Link& link() { return *link_; }
  const Link& link() const { return *link_; }

 private:
  const std::unique_ptr<Link> link_;
};

}  // namespace palpate::client
