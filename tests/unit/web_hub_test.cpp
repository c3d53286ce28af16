// The hub: newest wins, and who is told.
#include "client/web/hub/hub.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <memory>
#include <vector>

#include "client/web/wire/envelope.h"

namespace palpate::web {
namespace {

class Guest final : public Subscriber {
 public:
  void OnTopic(Topic topic) override {
    topics.push_back(topic);
    if (on_topic) on_topic();
  }
  void OnPose() override { ++poses; }

  std::vector<Topic> topics;
  int poses = 0;
  std::function<void()> on_topic;
};

TEST(Hub, TheNewestOfATopicWinsAndEqualTextsTellNobody) {
  Hub hub;
  Guest guest;
  hub.Put(Topic::kVolume, "a");
  hub.Subscribe(&guest);
  guest.topics.clear();
  EXPECT_EQ(*hub.Newest(Topic::kVolume), "a");
  EXPECT_EQ(hub.Newest(Topic::kSettings), nullptr);
  hub.Put(Topic::kVolume, "a");
  EXPECT_TRUE(guest.topics.empty());
  const auto before = hub.Newest(Topic::kVolume);
  hub.Put(Topic::kVolume, "b");
  hub.Put(Topic::kSettings, "c");
  EXPECT_EQ(guest.topics, (std::vector{Topic::kVolume, Topic::kSettings}));
  EXPECT_EQ(*hub.Newest(Topic::kVolume), "b");
  EXPECT_EQ(*before, "a") << "what is being written stays";
  hub.Unsubscribe(&guest);
}

TEST(Hub, PosesAreNumbered) {
  Hub hub;
  Guest guest;
  hub.Subscribe(&guest);
  EXPECT_EQ(hub.pose(), nullptr);
  for (std::uint32_t n = 1; n < 4; ++n) {
    hub.PutPose(std::string(176, 'x'));
    EXPECT_EQ(hub.pose_sequence(), n);
    std::uint32_t held = 0;
    std::memcpy(&held, hub.pose()->data() + kEnvelopeSequenceOffset, 4);
    EXPECT_EQ(held, n);
    EXPECT_EQ(hub.pose()->substr(0, 1) + hub.pose()->substr(5), std::string(172, 'x'));
  }
  EXPECT_EQ(guest.poses, 3);
  hub.Unsubscribe(&guest);
  hub.PutPose(std::string(176, 'x'));
  EXPECT_EQ(guest.poses, 3);
}

TEST(Hub, TheNumberOfGuestsIsATopic) {
  Hub hub;
  Guest one, other;
  hub.Subscribe(&one);
  hub.Subscribe(&other);
  EXPECT_EQ(hub.guests(), 2);
  EXPECT_EQ(*hub.Newest(Topic::kGuests), R"({"type":"guests","count":2})");
  EXPECT_EQ(one.topics.back(), Topic::kGuests);
  hub.Unsubscribe(&one);
  EXPECT_EQ(*hub.Newest(Topic::kGuests), R"({"type":"guests","count":1})");
  hub.Unsubscribe(&other);
  EXPECT_EQ(hub.guests(), 0);
}

// A guest whose connection breaks when it is written to, and takes others along.
TEST(Hub, GuestsMayLeaveWhileTheyAreTold) {
  Hub hub;
  std::vector<std::unique_ptr<Guest>> guests;
  for (int n = 0; n < 5; ++n) {
    guests.push_back(std::make_unique<Guest>());
    hub.Subscribe(guests.back().get());
  }
  const auto leave = [&](std::size_t n) {
    hub.Unsubscribe(guests[n].get());
    guests[n].reset();
  };
  Guest late;
  bool done = false;
  guests[2]->on_topic = [&] {
    if (std::exchange(done, true)) return;
    leave(0);
    leave(3);
    hub.Subscribe(&late);
  };
  hub.Put(Topic::kVolume, "a");
  EXPECT_EQ(hub.guests(), 4);
  EXPECT_EQ(guests[4]->topics.back(), Topic::kVolume);
  hub.PutPose(std::string(176, 'x'));
  for (const std::size_t n : {1, 2, 4}) EXPECT_EQ(guests[n]->poses, 1);
  EXPECT_EQ(late.poses, 1);
  // The last one leaves itself.
  guests[4]->on_topic = [&] { hub.Unsubscribe(guests[4].get()); };
  hub.Put(Topic::kVolume, "b");
  EXPECT_EQ(hub.guests(), 3);
}

}  // namespace
}  // namespace palpate::web
