// The framing of the Touch's serial line: cut anywhere, damaged anywhere.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "server/device/omni/usb_frames.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using test::Framed;

struct Frame {
  std::uint8_t command = 0;
  Bytes payload{};
  bool operator==(const Frame&) const = default;
};

std::vector<Frame> ParseAll(OmniUsbParser& parser, std::span<const std::uint8_t> bytes) {
  std::vector<Frame> frames;
  while (const auto frame = parser.Next(bytes)) {
    frames.push_back({frame->command, Bytes(frame->payload.begin(), frame->payload.end())});
  }
  EXPECT_TRUE(bytes.empty());
  return frames;
}

std::vector<Frame> ParseCut(OmniUsbParser& parser, std::span<const std::uint8_t> bytes,
                            std::mt19937& random, std::size_t longest) {
  std::vector<Frame> frames;
  while (!bytes.empty()) {
    const std::size_t cut = std::min<std::size_t>(random() % (longest + 1), bytes.size());
    for (Frame& frame : ParseAll(parser, bytes.first(cut))) frames.push_back(std::move(frame));
    bytes = bytes.subspan(cut);
  }
  return frames;
}

Bytes JoinedBytes(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Frames without a start in their payload, so that each is found again after damage.
std::vector<Frame> PlainFrames(std::mt19937& random, std::size_t count) {
  std::vector<Frame> frames;
  for (std::size_t n = 0; n < count; ++n) {
    Bytes payload(random() % 256);
    for (auto& byte : payload) byte = static_cast<std::uint8_t>(random() % 0xa5);
    frames.push_back({static_cast<std::uint8_t>(random()), payload});
  }
  return frames;
}

Bytes Stream(const std::vector<Frame>& frames) {
  Bytes bytes;
  for (const Frame& frame : frames)
    bytes = JoinedBytes({bytes, Framed(frame.command, frame.payload)});
  return bytes;
}

TEST(OmniUsbFrames, TheTracesBytesAreEncoded) {
  EXPECT_EQ(Framed(kOmniUsbSerialQuery.command, Bytes{0}), (Bytes{0xa5, 0x5a, 0x0c, 0x01, 0x00}));
  EXPECT_EQ(Framed(kOmniUsbServo.command, kOmniUsbServoOn),
            (Bytes{0xa5, 0x5a, 0x07, 0x07, 0x01, 0, 0, 0x80, 0, 0, 0}));
  const Bytes query = Framed(kOmniUsbFirmwareQuery.command, Bytes(32, 0));
  EXPECT_EQ(query.size(), 36u);
  EXPECT_EQ(query[2], 0x0f);
  EXPECT_EQ(query[3], 0x20);
}

TEST(OmniUsbFrames, WhatDoesNotFitIsNotEncoded) {
  Bytes out(kOmniUsbMaxFrameBytes + 10, 0xee);
  const Bytes untouched = out;
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(256), out), 0u);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(10), std::span(out).first(13)), 0u);
  EXPECT_EQ(EncodeOmniUsbFrame(1, {}, {}), 0u);
  EXPECT_EQ(out, untouched);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(255), out), kOmniUsbMaxFrameBytes);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(10), std::span(out).first(14)), 14u);
}

TEST(OmniUsbFrames, CutsDoNotMatter) {
  std::mt19937 random(1);
  for (int n = 0; n < test::Scaled(100); ++n) {
    // Any payload, with starts in it too: within a frame they mean nothing.
    std::vector<Frame> frames = PlainFrames(random, 30);
    for (Frame& frame : frames) {
      for (auto& byte : frame.payload) byte = random() % 3 ? byte : random() % 2 ? 0xa5 : 0x5a;
    }
    OmniUsbParser parser;
    ASSERT_EQ(ParseCut(parser, Stream(frames), random, n % 3 == 0 ? 1 : 700), frames);
    ASSERT_EQ(parser.corrupt_bytes(), 0u);
  }
}

TEST(OmniUsbFrames, CutsDoNotMatterInNoiseEither) {
  std::mt19937 random(2);
  for (int n = 0; n < 300; ++n) {
    Bytes noise(5000);
    for (auto& byte : noise) {
      byte = static_cast<std::uint8_t>(random() % 4 ? random() : random() % 2 ? 0xa5 : 0x5a);
    }
    OmniUsbParser whole, cut;
    for (auto* parser : {&whole, &cut}) parser->Expect({0x5a, 7});
    ASSERT_EQ(ParseAll(whole, noise), ParseCut(cut, noise, random, 40));
    ASSERT_EQ(whole.corrupt_bytes(), cut.corrupt_bytes());
    ASSERT_EQ(whole.corrupt_runs(), cut.corrupt_runs());
  }
}

TEST(OmniUsbFrames, GarbageBetweenFramesIsPassedOverAndCounted) {
  OmniUsbParser parser;
  const Bytes one = Framed(0x21, Bytes{1, 2, 3}), two = Framed(0x22, {});
  const Bytes stream =
      JoinedBytes({{0, 1, 2}, one, two, {0xa5, 0xa5, 0x5b}, one, {0xa5}, two, {0x5a}});
  const auto frames = ParseAll(parser, stream);
  ASSERT_EQ(frames.size(), 4u);
  EXPECT_EQ(frames[0], (Frame{0x21, {1, 2, 3}}));
  EXPECT_EQ(frames[3], (Frame{0x22, {}}));
  EXPECT_EQ(parser.corrupt_bytes(), 3u + 3u + 1u + 1u);
  EXPECT_EQ(parser.corrupt_runs(), 4u);
}

TEST(OmniUsbFrames, AnotherLengthThanTheKnownOneIsGarbage) {
  OmniUsbParser parser;
  parser.Expect({0x21, 3});
  // What the wrong length spans is searched: the frame in it is found.
  const Bytes good = Framed(0x21, Bytes{7, 8, 9});
  const auto frames = ParseAll(parser, JoinedBytes({{0xa5, 0x5a, 0x21, 200}, good, good}));
  EXPECT_EQ(frames, (std::vector<Frame>{{0x21, {7, 8, 9}}, {0x21, {7, 8, 9}}}));
  EXPECT_EQ(parser.corrupt_bytes(), 4u);
  EXPECT_EQ(parser.corrupt_runs(), 1u);
}

// Two readings are never mixed: what is left of the first is dropped.
TEST(OmniUsbFrames, ACutOffFrameIsNotFilledUpWithTheNext) {
  const Bytes cut_off = Framed(0x21, Bytes(44, 1)), good = Framed(0x21, Bytes(44, 2));
  for (std::size_t kept = 1; kept < cut_off.size(); ++kept) {
    OmniUsbParser parser;
    parser.Expect({0x21, 44});
    Bytes bytes(cut_off.begin(), cut_off.begin() + kept);
    for (int n = 0; n < 3; ++n) bytes = JoinedBytes({bytes, good});
    const auto frames = ParseAll(parser, bytes);
    // After two bytes the next start is taken for a command and its length.
    ASSERT_GE(frames.size(), kept == 2 ? 2u : 3u);
    for (const Frame& frame : frames) {
      // But for three bytes at its end, where a header may hide.
      if (frame.command != 0x21) continue;
      const Bytes start(frame.payload.begin(), frame.payload.begin() + 41);
      EXPECT_TRUE(start == Bytes(41, 1) || start == Bytes(41, 2)) << kept;
    }
    EXPECT_EQ(frames.back().payload, Bytes(44, 2));
    EXPECT_EQ(parser.corrupt_runs(), 1u);
  }
}

// Every byte of the stream with every other value: at most two frames are lost, and
// those behind are all there.
TEST(OmniUsbFrames, EverySingleDamagedByteIsSurvived) {
  constexpr std::uint8_t kState = 0x21;
  std::vector<Frame> frames;
  for (unsigned n = 0; n < 12; ++n) {
    Bytes payload(kOmniStateBytes);
    for (std::size_t i = 0; i < payload.size(); ++i) {
      payload[i] = static_cast<std::uint8_t>((i * 7 + n * 13) % 0xa5);
    }
    frames.push_back({kState, payload});
  }
  const Bytes good = Stream(frames);
  const std::size_t damaged_at = 2 * (kOmniUsbHeaderBytes + kOmniStateBytes);
  for (std::size_t at = damaged_at; at < damaged_at + 48; ++at) {
    for (unsigned value = 0; value < 256; ++value) {
      Bytes bytes = good;
      if (bytes[at] == value) continue;
      bytes[at] = static_cast<std::uint8_t>(value);
      OmniUsbParser parser;
      parser.Expect({kState, kOmniStateBytes});
      auto found = ParseAll(parser, bytes);
      std::erase_if(found, [](const Frame& frame) { return frame.command != kState; });
      ASSERT_GE(found.size(), frames.size() - 1) << at << " " << value;
      ASSERT_TRUE(std::equal(frames.end() - 9, frames.end(), found.end() - 9));
    }
  }
}

// Where a length is damaged that nobody knows, 255 bytes are the worst.
TEST(OmniUsbFrames, ADamagedUnknownLengthTakesNoMoreThanAFrameAlong) {
  std::mt19937 random(3);
  std::vector<Frame> frames = PlainFrames(random, 60);
  for (Frame& frame : frames) frame.payload.resize(44, 1);
  for (unsigned length = 0; length < 256; ++length) {
    Bytes bytes = Stream(frames);
    bytes[3] = static_cast<std::uint8_t>(length);
    OmniUsbParser parser;
    const auto found = ParseAll(parser, bytes);
    ASSERT_GE(found.size(), frames.size() - 7);
    ASSERT_TRUE(std::equal(frames.end() - 50, frames.end(), found.end() - 50));
  }
}

}  // namespace
}  // namespace palpate
