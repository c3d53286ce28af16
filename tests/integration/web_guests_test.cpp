// Guests' WebSockets: what they are told, what they may say, and what becomes of those that do not
// read.
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "client/web/http/guest.h"
#include "client/web/wire/envelope.h"
#include "tests/support/web_rig.h"

namespace palpate::test {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using web::Topic;

const std::string kLecturer = R"({"token":")" + kToken + "\"}";

std::uint32_t SequenceOf(const std::string& pose) {
  std::uint32_t sequence = 0;
  std::memcpy(&sequence, &pose.at(kEnvelopeSequenceOffset), sizeof sequence);
  return sequence;
}

std::string AckOf(std::uint32_t sequence) {
  return R"({"type":"ack","sequence":)" + std::to_string(sequence) + "}";
}

std::string SteerOf(int id, const std::string& key, const std::string& value) {
  return R"({"type":"steer","id":)" + std::to_string(id) + R"(,"key":")" + key + R"(","value":)" +
         value + "}";
}

// Returns the error of the answer to `id`, or "closed".
std::string AnswerTo(TestGuest& guest, int id) {
  const std::string text = guest.ReadUntil(R"("id":)" + std::to_string(id) + ",");
  return text.empty() ? "closed" : json::parse(text)["error"].get<std::string>();
}

TEST(WebGuests, HearHelloThenTheNewestOfEverything) {
  WebRig rig;
  rig.Put(Topic::kVolume, R"({"type":"volume","name":"old"})");
  rig.Put(Topic::kVolume, "volume");
  rig.Put(Topic::kSettings, "settings");
  rig.PutPoses(1);
  TestGuest guest(rig);
  ASSERT_TRUE(guest.is_open());
  EXPECT_EQ(guest.Read(), R"({"type":"hello","user":"guest-1"})");
  std::set<std::string> told;
  while (told.size() < 4 && guest.is_open()) {
    const std::string message = guest.Read();
    EXPECT_EQ(guest.got_text(), message.starts_with('{')) << message;
    told.insert(message);
  }
  std::string pose(176, '\1');
  const std::uint32_t sequence = 1;
  std::memcpy(&pose.at(kEnvelopeSequenceOffset), &sequence, sizeof sequence);
  const std::set<std::string> newest = {"volume", "settings", R"({"type":"guests","count":1})",
                                        pose};
  EXPECT_EQ(told, newest);

  rig.Put(Topic::kSeries, "series");
  EXPECT_EQ(guest.Read(), "series");
}

TEST(WebGuests, RunThePagesOwnScriptsAlone) {
  WebRig rig;
  const WebResponse page = Browser(rig).Get("/");
  EXPECT_NE(page["Content-Security-Policy"].find("script-src 'self';"), std::string::npos);
  EXPECT_EQ(page["X-Content-Type-Options"], "nosniff");
}

TEST(WebGuests, NeedLoginAndOrigin) {
  WebRig rig;
  const auto status = [&](const Fields& fields, bool logs_in) {
    Browser browser(rig);
    if (logs_in) browser.LogIn();
    return browser.Join(fields).result_int();
  };
  EXPECT_EQ(status({}, true), 101u);
  EXPECT_EQ(status({}, false), 401u);
  EXPECT_EQ(status({{"Cookie", "palpate_session=" + std::string(32, '0')}}, false), 401u);
  EXPECT_EQ(status({{"Origin", "https://evil.example"}}, true), 403u);
  EXPECT_EQ(status({{"Origin", ""}}, true), 403u);
  EXPECT_EQ(status({{"Host", "evil.example"}}, true), 421u);
  EXPECT_EQ(status({{"Upgrade", "h2c"}}, true), 426u);
  // Byte by byte: with an Origin, an empty one, and none.
  const auto raw_status = [&](const std::string& origin) {
    Browser browser(rig);
    browser.LogIn();
    browser.SendBytes("GET /stream HTTP/1.1\r\nHost: " + rig.host() +
                      "\r\nCookie: " + browser.cookie + "\r\n" + origin +
                      "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                      "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
    return browser.Receive().result_int();
  };
  EXPECT_EQ(raw_status("Origin: " + rig.origin() + "\r\n"), 101u);
  EXPECT_EQ(raw_status("Origin:\r\n"), 403u);
  EXPECT_EQ(raw_status(""), 403u);
}

TEST(WebGuests, AreNotToldOfEveryoneWhoJoins) {
  web::HttpOptions options;
  options.timeouts.sweep = std::chrono::hours(1);
  WebRig rig(options);
  TestGuest guest(rig);
  EXPECT_NE(guest.ReadUntil("guests"), "");
  for (int n = 0; n < 50; ++n) EXPECT_TRUE(TestGuest(rig).is_open());
  rig.Put(Topic::kSeries, "{}");
  rig.Put(Topic::kVolume, R"({"last":1})");
  int messages = 0;
  while (guest.is_open() && guest.Read().find("last") == std::string::npos) ++messages;
  EXPECT_LE(messages, 4);
}

TEST(WebGuests, AreAsManyAsMayBe) {
  web::HttpOptions options;
  options.max_guests = 2;
  WebRig rig(options);
  TestGuest first(rig);
  {
    TestGuest second(rig);
    EXPECT_TRUE(second.is_open());
    Browser third(rig);
    third.LogIn();
    EXPECT_EQ(third.Join().result_int(), 503u);
    EXPECT_EQ(rig.counts().guests, 2);
  }
  EXPECT_TRUE(Eventually([&] { return rig.counts().guests == 1; }));
  EXPECT_TRUE(TestGuest(rig).is_open());
}

TEST(WebGuests, WhoLogsOutIsToldNoMore) {
  web::HttpOptions options;
  options.timeouts.sweep = milliseconds(10);
  WebRig rig(options);
  Browser browser(rig);
  browser.LogIn();
  TestGuest guest(rig, {{"Cookie", browser.cookie}}, "");
  TestGuest other(rig);
  ASSERT_TRUE(guest.is_open());
  browser.Send(http::verb::post, "/logout");
  EXPECT_EQ(guest.CloseCode(), websocket::close_code::policy_error);
  rig.Put(Topic::kSeries, R"({"type":"series"})");
  EXPECT_NE(other.ReadUntil("series"), "");
}

TEST(WebGuests, MayNotSteer) {
  WebRig rig;
  TestGuest guest(rig);
  guest.Send(SteerOf(1, "isovalue", "1"));
  EXPECT_NE(AnswerTo(guest, 1), "");
  EXPECT_EQ(rig.steered().size(), 0u);
  EXPECT_EQ(rig.refused("steering"), 1);
}

TEST(WebGuests, UsersSteerWhatTheyMay) {
  WebRig rig;
  TestGuest lecturer(rig, kLecturer);
  lecturer.Send(SteerOf(1, "isovalue", "-123.5"));
  EXPECT_EQ(AnswerTo(lecturer, 1), "");
  ASSERT_EQ(rig.steered().size(), 1u);
  EXPECT_EQ(rig.steered()[0].user, "lecturer");
  EXPECT_EQ(rig.steered()[0].key, "isovalue");
  EXPECT_EQ(rig.steered()[0].value, -123.5);
  int id = 1;
  for (const auto& [key, value] : {std::pair<std::string, std::string>{"stiffness_n_per_mm", "1"},
                                   {"forces", "1"},
                                   {"pop_force_n", "-0.1"},
                                   {"pop_force_n", "3.4"},
                                   {"pop_force_n", "1e300"}}) {
    lecturer.Send(SteerOf(++id, key, value));
    EXPECT_NE(AnswerTo(lecturer, id), "") << key << value;
  }
  EXPECT_EQ(rig.steered().size(), 1u);
}

TEST(WebGuests, WhatPalpatedRefusesIsToldAsData) {
  WebRig rig;
  rig.OnNetwork([&] {
    rig.hub().steer = [](web::SteerRequest, std::function<void(std::string)> done) {
      done("\"}<script>\n\xff");
    };
  });
  TestGuest lecturer(rig, kLecturer);
  lecturer.Send(SteerOf(1, "isovalue", "1"));
  EXPECT_EQ(AnswerTo(lecturer, 1).substr(0, 11), "\"}<script>\n");
}

TEST(WebGuests, AnAnswerThatComesTooLateIsDropped) {
  WebRig rig;
  std::function<void(std::string)> answer;
  rig.OnNetwork([&] {
    rig.hub().steer = [&](web::SteerRequest, std::function<void(std::string)> done) {
      answer = std::move(done);
    };
  });
  {
    TestGuest lecturer(rig, kLecturer);
    lecturer.Send(SteerOf(1, "isovalue", "1"));
    EXPECT_TRUE(Eventually([&] { return rig.OnNetwork([&] { return answer != nullptr; }); }));
  }
  EXPECT_TRUE(Eventually([&] { return rig.counts().guests == 0; }));
  rig.OnNetwork([&] { answer(""); });
}

// That it is ten a second is a test of access, without a clock. Here: that access is asked.
TEST(WebGuests, SteerAsOftenAsAccessAllows) {
  WebRig rig;
  TestGuest lecturer(rig, kLecturer);
  constexpr int kSent = 60;
  for (int id = 1; id <= kSent; ++id) lecturer.Send(SteerOf(id, "isovalue", std::to_string(id)));
  int done = 0;
  for (int id = 1; id <= kSent; ++id) done += AnswerTo(lecturer, id).empty() ? 1 : 0;
  EXPECT_LT(done, kSent);
  EXPECT_EQ(rig.steered().size(), static_cast<std::size_t>(done));
  EXPECT_EQ(rig.refused("steering"), kSent - done);
}

TEST(WebGuests, WhoSaysAnythingElseIsClosed) {
  WebRig rig;
  for (const std::string& text : {std::string(),
                                  std::string("{"),
                                  std::string("null"),
                                  std::string("[]"),
                                  std::string("7"),
                                  std::string("{}"),
                                  std::string(R"({"type":"load","path":"/etc/passwd"})"),
                                  std::string(R"({"type":7})"),
                                  std::string(R"({"type":"ack"})"),
                                  AckOf(1),
                                  std::string(R"({"type":"ack","sequence":-1})"),
                                  std::string(R"({"type":"ack","sequence":1.5})"),
                                  std::string(R"({"type":"ack","sequence":4294967296})"),
                                  SteerOf(1, "isovalue", "NaN"),
                                  SteerOf(1, "isovalue", "1e999"),
                                  SteerOf(1, "isovalue", "null"),
                                  SteerOf(1, "isovalue", "\"1\""),
                                  SteerOf(-1, "isovalue", "1"),
                                  std::string(R"({"type":"steer","id":1,"key":7,"value":1})"),
                                  std::string(1024, '[')}) {
    TestGuest lecturer(rig, kLecturer);
    lecturer.Send(text);
    EXPECT_EQ(lecturer.CloseCode(), websocket::close_code::policy_error) << text;
  }
  TestGuest binary(rig, kLecturer);
  binary.SendBinary(SteerOf(1, "isovalue", "1"));
  EXPECT_EQ(binary.CloseCode(), websocket::close_code::policy_error);
  TestGuest large(rig, kLecturer);
  large.Send(SteerOf(1, std::string(1024, 'x'), "1"));
  EXPECT_EQ(large.CloseCode(), websocket::close_code::too_big);
  TestGuest garbled(rig, kLecturer);
  garbled.Send("\xff\xfe");
  EXPECT_EQ(garbled.CloseCode(), websocket::close_code::bad_payload);
  EXPECT_EQ(rig.steered().size(), 0u);
  EXPECT_TRUE(Eventually([&] { return rig.counts().guests == 0; }));
}

TEST(WebGuests, WhoSaysTooMuchIsClosed) {
  web::HttpOptions options;
  options.timeouts.sweep = std::chrono::hours(1);  // one time span for all messages
  WebRig rig(options);
  TestGuest guest(rig);
  const int most = web::Guest::kMostMessages;
  for (int id = 1; id <= most; ++id) guest.Send(SteerOf(id, "isovalue", "1"));
  EXPECT_NE(AnswerTo(guest, most), "closed");
  guest.Send(SteerOf(most + 1, "isovalue", "1"));
  EXPECT_EQ(guest.CloseCode(), websocket::close_code::policy_error);
}

// Frames of a message that never ends, all empty.
TEST(WebGuests, WhoSaysNothingTooOftenIsClosed) {
  web::HttpOptions options;
  options.timeouts.sweep = milliseconds(500);
  WebRig rig(options);
  TestGuest guest(rig);
  EXPECT_NE(guest.ReadUntil("hello"), "");
  const std::string mask(4, '\0');
  std::string frames = "\x01\x80" + mask;
  for (int n = 0; n < 25000; ++n) frames += std::string("\0\x80", 2) + mask;
  ErrorCode error;
  asio::write(guest.tcp_socket(), asio::buffer(frames), error);
  EXPECT_EQ(guest.CloseCode(), websocket::close_code::policy_error);
  EXPECT_EQ(rig.refused("flood"), 1);
}

// Against a plain list.
TEST(WebGuests, TheWindowCountsWhatIsNotAcknowledged) {
  std::mt19937 random(5);
  web::PoseWindow window;
  std::vector<std::uint32_t> sent;  // unacknowledged
  std::uint32_t next = 0xfffffff0u, newest = 0;
  EXPECT_FALSE(window.Acknowledge(0));
  for (int n = 0; n < 20000; ++n) {
    ASSERT_EQ(window.IsFull(), sent.size() == web::PoseWindow::kMost);
    if (!window.IsFull() && random() % 4 != 0) {
      next += 1 + random() % 3;
      window.Sent(next);
      sent.push_back(newest = next);
    } else if (n > 0) {
      const std::uint32_t sequence = newest + 2 - random() % 50;
      const bool is_known = static_cast<std::int32_t>(sequence - newest) <= 0;
      ASSERT_EQ(window.Acknowledge(sequence), is_known);
      if (is_known) {
        std::erase_if(sent, [&](std::uint32_t one) {
          return static_cast<std::int32_t>(sequence - one) >= 0;
        });
      }
    }
  }
}

TEST(WebGuests, GetThirtyTwoPosesUntilTheyAcknowledge) {
  web::HttpOptions options;
  options.timeouts.acknowledge = milliseconds(500);
  options.timeouts.sweep = milliseconds(10);
  WebRig rig(options);
  TestGuest guest(rig);
  EXPECT_NE(guest.ReadUntil("guests"), "");
  const auto next_pose = [&] {
    std::string message;
    do message = guest.Read();
    while (guest.is_open() && guest.got_text());
    return message.empty() ? 0 : SequenceOf(message);
  };
  // One by one, for of many at once a guest gets the newest.
  for (std::uint32_t n = 1; n <= 32; ++n) {
    rig.PutPoses(1);
    ASSERT_EQ(next_pose(), n);
  }
  rig.PutPoses(8);
  guest.Send(AckOf(1));
  EXPECT_EQ(next_pose(), 40u);
  guest.Send(AckOf(40));
  for (std::uint32_t n = 41; n < 41 + 32; ++n) {
    rig.PutPoses(1);
    ASSERT_EQ(next_pose(), n);
  }
  // The end, for nothing more is acknowledged.
  rig.PutPoses(1);
  EXPECT_EQ(next_pose(), 0u);
  EXPECT_FALSE(guest.is_open());
  EXPECT_TRUE(Eventually([&] { return rig.left("slow") == 1; }));
}

TEST(WebGuests, WhoReadsSlowlySkipsToTheNewest) {
  web::HttpOptions options;
  // However long the machine takes to put all.
  options.timeouts.write = options.timeouts.keep_alive = std::chrono::minutes(5);
  WebRig rig(options);
  TestGuest guest(rig);
  constexpr int kTexts = 400;
  constexpr std::size_t kBytes = 200'000;
  for (int n = 1; n <= kTexts; ++n) {
    rig.Put(Topic::kSettings,
            R"({"n":)" + std::to_string(n) + ",\"" + std::string(kBytes, 'x') + "\"}");
    ASSERT_LT(rig.counts().held_bytes, 2 * kBytes);
  }
  int read = 1;
  while (guest.is_open() && guest.Read().find(R"({"n":400,)") != 0) ++read;
  EXPECT_TRUE(guest.is_open());
  EXPECT_LT(read, kTexts);
}

TEST(WebGuests, WhoDoesNotReadIsDroppedAndCostsNobodyAnything) {
  web::HttpOptions options;
  options.timeouts.write = std::chrono::seconds(3);
  options.timeouts.sweep = milliseconds(10);
  WebRig rig(options);
  TestGuest reader(rig);
  std::vector<std::unique_ptr<TestGuest>> stalled;
  for (int n = 0; n < 5; ++n) stalled.push_back(std::make_unique<TestGuest>(rig));
  constexpr std::size_t kBytes = 50'000;
  rig.Feed(kBytes);
  std::size_t held = 0;
  int texts = 0;
  while (reader.is_open() && rig.left("slow") < 5) {
    EXPECT_NE(reader.ReadUntil("settings"), "");
    held = std::max(held, rig.counts().held_bytes);
    ++texts;
  }
  // One message of each.
  EXPECT_LT(held, 6 * (kBytes + 1000));
  EXPECT_TRUE(reader.is_open());
  EXPECT_EQ(rig.counts().guests, 1);
  // What comes still comes.
  for (int n = 0; n < 10; ++n) EXPECT_NE(reader.ReadUntil("settings"), "");
  for (const auto& guest : stalled) EXPECT_EQ(guest->CloseCode(), 0);
}

TEST(WebGuests, TheEndOfTheServerIsTheEndOfTheirConnections) {
  WebRig rig;
  TestGuest guest(rig);
  EXPECT_NE(guest.ReadUntil("hello"), "");
  rig.Feed();
  rig.OnNetwork([&] { rig.server().Stop(); });
  EXPECT_EQ(guest.CloseCode(), 0);
  EXPECT_EQ(rig.OnNetwork([&] { return rig.hub().guests(); }), 0);
  EXPECT_EQ(rig.counts().connections, 0);
}

}  // namespace
}  // namespace palpate::test
