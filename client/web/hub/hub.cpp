#include "client/web/hub/hub.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

namespace palpate::web {

void Hub::Put(Topic topic, std::string message) {
  std::shared_ptr<const std::string>& newest = newest_.at(static_cast<std::size_t>(topic));
  if (newest && *newest == message) return;
  newest = std::make_shared<const std::string>(std::move(message));
  Tell([topic](Subscriber& subscriber) { subscriber.OnTopic(topic); });
}

void Hub::PutPose(std::string bytes) {
  static_assert(std::endian::native == std::endian::little, "as protobuf writes numbers");
  ++sequence_;
  std::memcpy(&bytes.at(kEnvelopeSequenceOffset), &sequence_, sizeof(sequence_));
  pose_ = std::make_shared<const std::string>(std::move(bytes));
  Tell([](Subscriber& subscriber) { subscriber.OnPose(); });
}

std::shared_ptr<const std::string> Hub::Newest(Topic topic) const {
  return newest_.at(static_cast<std::size_t>(topic));
}

void Hub::Subscribe(Subscriber* subscriber) {
  subscribers_.push_back(subscriber);
  CountGuests();
}

void Hub::Unsubscribe(Subscriber* subscriber) {
  std::replace(subscribers_.begin(), subscribers_.end(), subscriber,
               static_cast<Subscriber*>(nullptr));
  CountGuests();
}

int Hub::guests() const {
  return static_cast<int>(
      std::count_if(subscribers_.begin(), subscribers_.end(), [](const Subscriber* subscriber) {
        return subscriber != nullptr && subscriber->is_guest();
      }));
}

void Hub::CountGuests() {
  Put(Topic::kGuests, R"({"type":"guests","count":)" + std::to_string(guests()) + "}");
}

// By index: the list may grow while subscribers are told.
void Hub::Tell(const std::function<void(Subscriber&)>& call) {
  ++telling_;
  for (std::size_t n = 0; n < subscribers_.size(); ++n) {
    if (subscribers_[n] != nullptr) call(*subscribers_[n]);
  }
  if (--telling_ == 0) std::erase(subscribers_, nullptr);
}

}  // namespace palpate::web
