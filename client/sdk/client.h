// A client of palpated: newest pose, settings, edits, a copy of the volume.
//
// It connects by itself, and again after every loss: after 0.1 s at first, then after
// twice as long each time up to 5 s, each pause shortened at random by up to a half so
// that many clients do not come back at once. What it followed it follows again; the
// copy of the volume resumes from its revision.
//
// Threads: all methods may be called from any thread, and from callbacks, but for the
// destructor, which may be called by none of them. Every callback has one thread of its
// own kind, named below, so that no callback runs beside itself; different ones may.
// They may come before the constructor has returned. None runs once the destructor
// has returned, which waits for those that run: they must come back.
// A callback that throws ends the program.
//
// Errors: Error (common/error/error.h) with the daemon's own line. Calls have a
// deadline of 5 s, and end with kUnavailable when palpated is not reached; they do not
// wait for a connection. kCancelled: the client is being destroyed.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/connection.h"
#include "client/sdk/daemon_info.h"
#include "client/sdk/edit.h"
#include "client/sdk/pose.h"
#include "client/sdk/server_choice.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume_update.h"
#include "common/error/error.h"

namespace palpate::client {

struct Callbacks {
  // The pose thread: every change of the connection, also of the reason of a loss.
  std::function<void(const Connection&)> on_connection{};
  // The pose thread: poses as they come. While it runs, no newer one is taken, also not
  // by NewestPose. A slow one gets at once all that piled up behind it; beyond 16
  // messages the oldest are lost, and the last is fresh always.
  std::function<void(const PoseBatch&)> on_poses{};
  // The settings thread: settings that are new, whoever changed them; once after
  // every connection. Changes that follow each other closely come as one.
  std::function<void(const Settings&)> on_settings{};
  // The volume thread: there is something for TakeVolumeUpdate.
  std::function<void()> on_volume{};
};

struct ClientOptions {
  // Of clients.toml; empty: what follows, with what the environment adds (server_choice.h).
  std::string profile{};
  Address address{};
  Credentials credentials{};
  PoseRate poses{};
  // Keep a copy of the volume. It travels on a connection of its own, so that poses
  // do not queue behind voxels.
  bool follow_volume = false;
  Callbacks callbacks{};
};

class Client {
 public:
  // Returns at once and connects meanwhile. Errors: kInvalidArgument for an address,
  // credentials, a profile or a rate that are none, kNotFound for a profile or files of
  // credentials, kPermissionDenied as DefaultSocketPath.
  explicit Client(ClientOptions options = {});
  // Ends within a fraction of a second, connected or not.
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // Ends with kCancelled the calls that run on any thread, and all later ones at once:
  // to join threads that call before this is destroyed.
  void EndCalls();
  // Ends streams, calls and connections, for good: connection() is lost, "disconnected". What was
  // taken stays. Not from callbacks.
  void Disconnect();

  Connection connection() const;
  // False where it is not connected within `timeout`; connection() says why. Not from
  // callbacks.
  bool WaitUntilConnected(std::chrono::milliseconds timeout) const;
  // "unix:/run/palpate/palpated.sock" or "localhost:7400", for people.
  const std::string& name() const;
  // It is reached by a socket of this machine, so that Pose::time_ns is of
  // steady_clock. Unknown over TCP, hence false.
  bool shares_clock() const;

  // The newest that was taken, also after a loss; none before the first. For render
  // threads: it copies one Pose under a lock that nobody holds for longer.
  std::optional<Pose> NewestPose() const;
  // Samples that were lost so far because this client was slow.
  std::uint64_t dropped_poses() const;
  // From the next message on. Errors: kInvalidArgument.
  void SetPoseRate(const PoseRate& rate);

  // The newest that are known, as on_settings gets them; none before the first
  // connection. Within about a message of poses of what the daemon has.
  std::optional<Settings> NewestSettings() const;
  // Asks the daemon.
  Settings GetSettings();
  // Answers when the servo has used them. Errors: kInvalidArgument (out of range,
  // nothing to change), kConflict (expected_revision), kUnavailable.
  SettingsResult Set(const SettingsUpdate& update);

  // Answer when the servo has used it. Errors: as in volume.proto; kTooLarge for more
  // than 16 777 216 voxels, kConflict for a revision, and for nothing to undo or redo.
  EditResult Apply(const Edit& edit);
  // Answers when the servo has used it, and has no deadline: it may take minutes. `progress` has
  // the share done, 0 to 1, on the caller's thread; false cancels (kCancelled). Others can edit
  // meanwhile. kConflict also where another filter runs.
  EditResult RunFilter(const Filter& filter, const std::function<bool(double fraction)>& progress);
  // `expected_revision`: refuse with kConflict unless the volume is at it, so that no
  // change of another client is taken back.
  EditResult Undo(std::optional<std::uint64_t> expected_revision = {});
  EditResult Redo(std::optional<std::uint64_t> expected_revision = {});
  // To the volume as it was loaded, as one edit.
  EditResult Revert();

  // What came since the last call, merged: newest wins. None where nothing did, and
  // where the volume is not followed. For one taker, for what is taken is gone.
  std::optional<VolumeUpdate> TakeVolumeUpdate();
  VolumeStatus volume_status() const;

  DeviceInfo GetDevice();
  // `device`: its configuration name; may be empty where its forces are verified, or
  // simulated. Errors: kFailedPrecondition says what keeps the forces off.
  ForceResult EnableForces(const std::string& device = {});
  // Ramps forces out, until they are enabled again.
  ForceResult DisableForces();
  // Emergency stop: zero force within a tick, until forces are enabled again.
  ForceResult StopForces();

  // Errors: kConflict where no series is loaded.
  SeriesState GetSeries();
  SeriesState ControlSeries(const SeriesControl& control);

  // `path`: absolute, on the daemon's machine. Errors: as in recording.proto.
  RecordingState StartRecording(const std::string& path, bool overwrite = false);
  RecordingState StopRecording();
  RecordingState GetRecording();
  // Puts a marker into the recording; returns its time, as Pose::time_ns.
  std::int64_t Mark(const std::string& text);

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::client
