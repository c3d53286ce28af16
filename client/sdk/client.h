// A client that follows palpated by itself: the newest pose, the facts (settings, volume, device,
// recording, people), a copy of the volume. It also has all calls of Calls.
//
// The client connects by itself, and again after every loss. The first pause is 0.1 s. Each later
// pause is twice as long, up to 5 s. Each pause is shortened at random by up to a half, so that
// many clients do not come back at once. After a loss the client follows the same things as before.
// The copy of the volume resumes from its revision.
//
// Threads: call all methods from any thread and from callbacks. Exception: no callback may destroy
// the client.
// Callbacks: each kind has a thread of its own, named below. So a callback never runs twice at the
// same time, but different kinds may. Callbacks may run before the constructor has returned. The
// destructor waits for running callbacks, so they must return. No callback runs after the
// destructor has returned. A callback that throws ends the program, unless its client is ending
// and it throws the Error of a call.
//
// Errors: as Calls, but calls do not wait for a connection. kCancelled: the client is being
// destroyed.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/sdk/calls.h"
#include "client/sdk/connection.h"
#include "client/sdk/facts.h"
#include "client/sdk/pose.h"
#include "client/sdk/volume_update.h"

namespace palpate::client {

struct Callbacks {
  // The pose thread: called for every change of the connection, also when the reason of a loss
  // changes.
  std::function<void(const Connection&)> on_connection{};
  // The pose thread: new poses. While the callback runs, the client takes no newer pose, and
  // NewestPose does not change. A slow callback gets all waiting poses at once. Beyond 16 waiting
  // messages the oldest are lost. The last pose is always fresh.
  std::function<void(const PoseBatch&)> on_poses{};
  // The facts thread: called when settings are new, whoever changed them, and once after every
  // connection. Changes in quick succession may arrive as one.
  std::function<void(const Settings&)> on_settings{};
  // The facts thread: a fact is new. Gets all facts that are known.
  std::function<void(const Facts&)> on_facts{};
  // The volume thread: TakeVolumeUpdate has something.
  std::function<void()> on_volume{};
};

struct ClientOptions {
  // A profile of clients.toml. If empty: the fields below, completed by the environment
  // (server_choice.h).
  std::string profile{};
  Address address{};
  Credentials credentials{};
  PoseRate poses{};
  // Keep a copy of the volume. Voxels have a connection of their own, so that poses do not wait for
  // voxels.
  bool follow_volume = false;
  Callbacks callbacks{};
};

class Client : public Calls {
 public:
  // Returns at once; connects in the background. Errors: kInvalidArgument (address, credentials,
  // profile or rate), kNotFound (a profile or a file of the credentials), kPermissionDenied as
  // DefaultSocketPath.
  explicit Client(ClientOptions options = {});
  // Returns within a fraction of a second, connected or not.
  ~Client() override;

  // Ends streams, calls and connections for good. connection() is then lost, "disconnected".
  // Received poses, settings and voxels stay. Do not call it from callbacks.
  void Disconnect();

  Connection connection() const;
  // Returns false if the client is not connected within `timeout`; connection() says why. Do not
  // call it from callbacks.
  bool WaitUntilConnected(std::chrono::milliseconds timeout) const;

  // The newest pose received, also after a loss; none before the first. For render threads: it
  // copies one Pose under a lock that is never held for longer than such a copy.
  std::optional<Pose> NewestPose() const;
  // Samples lost so far because this client was slow.
  std::uint64_t dropped_poses() const;
  // Takes effect with the next message. Errors: kInvalidArgument.
  void SetPoseRate(const PoseRate& rate);

  // The newest settings known, as on_settings gets them; none before the first connection. They
  // come some milliseconds after a change.
  std::optional<Settings> NewestSettings() const;
  // The newest facts received, also after a loss until there is another connection; never null.
  // Makes no call: ask as often as you like.
  std::shared_ptr<const Facts> NewestFacts() const;
  // As Calls::GetSettings. Afterwards NewestSettings is at least as new.
  Settings GetSettings() override;
  SettingsResult Set(const SettingsUpdate& update) override;

  // Returns all changes since the last call, merged; the newest values win. None if nothing changed
  // or the volume is not followed. Use it from one place only: each change is returned once.
  std::optional<VolumeUpdate> TakeVolumeUpdate();
  VolumeStatus volume_status() const;

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::client
