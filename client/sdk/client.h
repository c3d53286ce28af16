// A client that keeps up with palpated by itself: newest pose, settings, a copy of the volume. And
// all calls of Calls.
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
// Errors: as Calls; calls do not wait for a connection. kCancelled: the client is being destroyed.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/calls.h"
#include "client/sdk/connection.h"
#include "client/sdk/pose.h"
#include "client/sdk/volume_update.h"

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

class Client : public Calls {
 public:
  // Returns at once and connects meanwhile. Errors: kInvalidArgument for an address,
  // credentials, a profile or a rate that are none, kNotFound for a profile or files of
  // credentials, kPermissionDenied as DefaultSocketPath.
  explicit Client(ClientOptions options = {});
  // Ends within a fraction of a second, connected or not.
  ~Client() override;

  // Ends streams, calls and connections, for good: connection() is lost, "disconnected". What was
  // taken stays. Not from callbacks.
  void Disconnect();

  Connection connection() const;
  // False where it is not connected within `timeout`; connection() says why. Not from
  // callbacks.
  bool WaitUntilConnected(std::chrono::milliseconds timeout) const;

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
  // As Calls'; NewestSettings is at least as new then.
  Settings GetSettings() override;
  SettingsResult Set(const SettingsUpdate& update) override;

  // What came since the last call, merged: newest wins. None where nothing did, and
  // where the volume is not followed. For one taker, for what is taken is gone.
  std::optional<VolumeUpdate> TakeVolumeUpdate();
  VolumeStatus volume_status() const;

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::client
