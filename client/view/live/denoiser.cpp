#include "client/view/live/denoiser.h"

#include <atomic>

namespace palpate::view {

struct Denoiser::Progress {
  std::atomic<double> fraction{0.0};
  std::atomic<bool> is_cancelled{false};
};

Denoiser::Denoiser(Commands& commands) : commands_(commands) {}

void Denoiser::Start(const client::Filter& filter,
                     const std::function<void(const client::EditResult&)>& done) {
  if (commands_.busy()) return;
  progress_ = std::make_shared<Progress>();
  commands_.Do("filter", [filter, done, progress = progress_](client::Client& client) {
    done(client.RunFilter(filter, [&](const client::Progress& so_far) {
      progress->fraction = so_far.fraction;
      return !progress->is_cancelled;
    }));
  });
}

void Denoiser::Cancel() {
  if (progress_) progress_->is_cancelled = true;
}

std::optional<double> Denoiser::fraction() const {
  if (!progress_ || !commands_.busy()) return std::nullopt;
  return progress_->fraction.load();
}

}  // namespace palpate::view
