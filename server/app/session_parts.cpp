#include "server/app/session_parts.h"

#include <chrono>
#include <thread>

#include "server/app/first_volume.h"
#include "server/log/log.h"
#include "server/servo/tick_computation.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate {
namespace {

// Clients that wait for the volume ask five times a second.
constexpr std::chrono::milliseconds kLastAnswers{500};

std::filesystem::path ImportProgram() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

}  // namespace

SessionParts::SessionParts(const LoadedConfig& loaded, const DaemonPaths& paths,
                           Instrument& instrument)
    : loaded_(loaded),
      paths_(paths),
      instrument_(instrument),
      registrations_(paths.state_folder),
      session(instrument.device->spec(), instrument.inbox, instrument.pump,
              VolumeLoader{
                  .import_program = ImportProgram(),
                  .folders = paths.clients.load_folders(),
                  .own_files = paths.own_files,
                  .budget = MemoryBudget::Make(loaded.config.memory_budget_bytes, LiveBrickBytes)}),
      editor(session),
      recording(session, instrument.pump,
                {[&](const std::string& path) { return paths.clients.CheckSave(path); },
                 [&](const std::string& path) { return paths.clients.OpenToLoad(path); },
                 paths.clients.save_folders()},
                "palpated " PALPATE_VERSION, instrument.limits, PassivityDeviceOf(session.device()),
                [](const std::string& line, bool is_error) {
                  is_error ? LogError("{}", line) : LogWarning("{}", line);
                }),
      series(session),
      tools_(std::make_shared<StylusTools>(session, editor)),
      keeper_(paths.state_folder, paths.socket, ConfiguredVolume(loaded.config),
              ConfiguredSettings(loaded.config), [this] { return session.Felt(); }) {
  session.SetRegistrationStore(registrations_);
  session.SetKeeper(keeper_);
  session.SetInitial(ConfiguredSettings(loaded.config));
  instrument.pump.Subscribe(tools_);
  if (session.device().kind != SimulatedDeviceSpec().kind) return;
  hand_guide_.emplace(session, instrument.hand.plans);
  session.SetBeforeOtherVolume(
      [this](const HapticSurface& surface) { hand_guide_->MakeRoomFor(surface); });
}

SessionParts::~SessionParts() {
  session.store().TellEdits({});
  instrument_.servo.Stop();
  series.Stop();
  instrument_.pump.Stop();
}

void SessionParts::TakeLeft() { left_ = palpate::TakeLeft(loaded_.config, session, keeper_); }

bool SessionParts::LoadFirst(const std::function<void(const std::string&)>& on_progress,
                             const LoadCancelled& end_requested) {
  try {
    LoadFirstVolume(loaded_, session, left_, keeper_.ended_cleanly(), paths_.clients, on_progress,
                    end_requested);
  } catch (const Error& error) {
    keeper_.GiveBack();  // an end in order
    if (error.kind() != ErrorKind::kCancelled || !end_requested()) {
      session.first_load().Fail(error);
      if (session.first_load().was_asked()) std::this_thread::sleep_for(kLastAnswers);
      throw;
    }
    LogInfo("ended by a signal while the volume was loading");
    return false;
  }
  session.AwaitPlaceKept();  // before the session that names the volume
  tools_->Start();
  if (hand_guide_) hand_guide_->Start();
  keeper_.Start();
  session.store().TellEdits([this](std::uint64_t edits) { keeper_.NoteEdits(edits); });
  return true;
}

void SessionParts::End() {
  series.Stop();
  instrument_.pump.Stop();
  tools_->Stop();
  if (hand_guide_) hand_guide_->Stop();
  recording.End();
  session.store().TellEdits({});
  keeper_.End();
  if (const VolumeState last = session.volume(); last.unsaved_edits > 0) {
    LogWarning("edits of {} that were not saved are lost: {}", last.volume->metadata().source,
               last.unsaved_edits);
  }
}

}  // namespace palpate
