// All that palpated offers, as calls that wait for the answer.
//
//   palpate::client::Calls palpated;   // $PALPATE_SERVER, or the socket of this machine
//   palpated.LoadVolume("/data/head.nrrd", {.isovalue = 300.0});
//   auto saved = palpated.Async([](auto& p) { return p.SaveVolume("/data/edited.vdb"); });
//   palpated.Apply({.shape = palpate::client::Sphere{{12, -3, 40}, 5.0}, .value = -300.0});
//   std::printf("revision %llu\n", saved.get().volume_revision);
//
// Client adds what keeps up with the daemon by itself: poses, settings, a copy of the volume.
//
// Paths are on the daemon's machine and absolute, unless stated.
// Threads: all methods may be called from any thread, at once. Calls must outlive what it gave
// out: PoseReader, futures.
// Errors: Error (common/error/error.h) with the daemon's own line. kUnavailable: palpated is not
// reached, went away, or did not answer within 5 s; kPermissionDenied: our role is too small;
// kCancelled: by a ProgressFunction or EndCalls; and what each method names.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "client/sdk/device.h"
#include "client/sdk/download.h"
#include "client/sdk/edit.h"
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
  // Connects with the first call. Errors: kInvalidArgument for an address or credentials that
  // cannot be used, kNotFound for files of credentials, kPermissionDenied for a folder of the
  // socket that others may write to.
  explicit Calls(const Server& server = Resolve({}));
  virtual ~Calls();
  Calls(const Calls&) = delete;
  Calls& operator=(const Calls&) = delete;

  // For programs whose errors are lines of their own: the transport's log, which only adds to them,
  // goes nowhere unless the environment asks for it. On main, before all else.
  static void SilenceTransport();

  // "unix:/run/palpate/palpated.sock" or "localhost:7400", for people.
  const std::string& name() const;
  // It is reached by a socket of this machine, so that Pose::time_ns is of
  // steady_clock. Unknown over TCP, hence false.
  bool shares_clock() const;
  // Errors: why it is not reached within `timeout`, and what to do.
  void WaitUntilReached(std::chrono::milliseconds timeout) const;
  // Ends with kCancelled the calls that run on any thread, and all later ones at once.
  void EndCalls();

  // Runs work(*this) on a thread of its own. The future's destructor waits for it.
  template <class Work>
  std::future<std::invoke_result_t<Work, Calls&>> Async(Work work) {
    return std::async(std::launch::async,
                      [this, held = std::move(work)]() mutable { return held(*this); });
  }

  // `rate_hz` in (0, 1000], of loop time; `batch` samples in a message, 1 to 256.
  PoseReader ReadPoses(double rate_hz, std::uint32_t batch);

  // --- What is felt
  virtual Settings GetSettings();
  // Answers when the servo has used them. Errors: kInvalidArgument (out of range, nothing to
  // change), kConflict (expected_revision).
  virtual SettingsResult Set(const SettingsUpdate& update);
  Placement GetPlacement();
  // Answers when the servo has used it. Errors: kInvalidArgument (not finite, a scale out of
  // range, no rotation), kConflict (expected_revision).
  PlacementResult Place(const PlacementChange& change);

  // --- Volumes
  VolumeInfo GetVolume();
  // `source`: a file or DICOM folder, or "builtin:NAME[:N]". The volume before stays until this one
  // is complete, and where it fails. Errors: kInvalidArgument (no volume, a bad option), kNotFound,
  // kTooLarge, kConflict (another load runs), kCancelled.
  LoadResult LoadVolume(const std::string& source, const LoadOptions& options = {},
                        const ProgressFunction& progress = {});
  // The same with a file of this machine, of any format of one file that LoadVolume reads.
  LoadResult UploadVolume(const std::filesystem::path& file, const LoadOptions& options = {},
                          const ProgressFunction& progress = {});
  // A copy of the voxels as they are now. Errors: kTooLarge for more than 2^31 voxels.
  DownloadResult DownloadVolume(const ProgressFunction& progress = {});
  // The suffix of `path` says the format: .vdb or .nrrd. The file is whole, or as it was. Errors:
  // kConflict (it is there and may not be overwritten; another save runs), kNotFound (no such
  // folder), kDiskFull.
  SaveResult SaveVolume(const std::string& path, bool overwrite = false,
                        const ProgressFunction& progress = {});

  // --- Edits
  // Answers when the servo has used it. Errors: as in volume.proto; kTooLarge for more
  // than 16 777 216 voxels, kConflict for a revision, and for nothing to undo or redo.
  EditResult Apply(const Edit& edit);
  // Others can edit meanwhile. kConflict also where another filter runs.
  EditResult RunFilter(const Filter& filter, const ProgressFunction& progress = {});
  // `expected_revision`: refuse with kConflict unless the volume is at it, so that no
  // change of another client is taken back.
  EditResult Undo(std::optional<std::uint64_t> expected_revision = {});
  EditResult Redo(std::optional<std::uint64_t> expected_revision = {});
  // To the volume as it was loaded, as one edit.
  EditResult Revert(std::optional<std::uint64_t> expected_revision = {});

  // --- Time series
  // `sources`: files of one frame each in the order of time, or one file with several; a name may
  // be a pattern with * and ?. Errors: as LoadVolume.
  SeriesResult LoadSeries(const std::vector<std::string>& sources, const LoadOptions& options = {},
                          const ProgressFunction& progress = {});
  // Errors: kConflict where no series is loaded.
  SeriesState GetSeries();
  SeriesState ControlSeries(const SeriesControl& control);

  // --- Device and forces
  DaemonInfo GetDevice();
  std::vector<ListedDevice> ListDevices();
  // `device`: its configuration name; may be empty where its forces are verified, or
  // simulated. Errors: kFailedPrecondition says what keeps the forces off.
  ForceResult EnableForces(const std::string& device = {});
  // Ramps forces out, until they are enabled again.
  ForceResult DisableForces();
  // Emergency stop: zero force within a tick, until forces are enabled again.
  ForceResult StopForces();
  // Takes the stylus's place of rest as where it is when it is docked next. Errors:
  // kInvalidArgument (the device has none), kFailedPrecondition (it is not there).
  DeviceHealth CalibrateDevice();

  // --- Recordings. Errors: as in recording.proto.
  RecordingState StartRecording(const std::string& path, bool overwrite = false);
  RecordingState StopRecording();
  RecordingState GetRecording();
  // Puts a marker into the recording; returns its time, as Pose::time_ns.
  std::int64_t Mark(const std::string& text);
  // Plays a recording to all who watch, forces off. `speed`: times real time, to 100.
  // Returns its last state.
  ReplayState Replay(const std::string& path, double speed = 1.0,
                     const ReplayFunction& progress = {});

 protected:
  Link& link() { return *link_; }
  const Link& link() const { return *link_; }

 private:
  const std::unique_ptr<Link> link_;
};

}  // namespace palpate::client
