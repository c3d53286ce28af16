#include "server/device/omni/usb_frames.h"

#include <algorithm>

namespace palpate {
namespace {

constexpr std::array<std::uint8_t, 2> kStart = {0xa5, 0x5a};

}  // namespace

std::size_t EncodeOmniUsbFrame(std::uint8_t command, std::span<const std::uint8_t> payload,
                               std::span<std::uint8_t> out) noexcept {
  const std::size_t bytes = kOmniUsbHeaderBytes + payload.size();
  if (payload.size() > kOmniUsbMaxPayloadBytes || out.size() < bytes) return 0;
  out[0] = kStart[0];
  out[1] = kStart[1];
  out[2] = command;
  out[3] = static_cast<std::uint8_t>(payload.size());
  std::copy(payload.begin(), payload.end(), out.begin() + kOmniUsbHeaderBytes);
  return bytes;
}

void OmniUsbParser::Reset() noexcept {
  held_bytes_ = 0;
  frame_is_out_ = false;
  in_run_ = false;
}

std::optional<OmniUsbFrame> OmniUsbParser::Next(std::span<const std::uint8_t>& bytes) noexcept {
  if (frame_is_out_) {
    frame_is_out_ = false;
    held_bytes_ = 0;
  }
  for (;;) {
    // Takes no more bytes than the header is known to announce. If the frame is wrong, only these
    // few bytes are searched again.
    const bool has_header = held_bytes_ >= kOmniUsbHeaderBytes;
    const std::size_t wanted = has_header ? kOmniUsbHeaderBytes + held_[3] : kOmniUsbHeaderBytes;
    const std::size_t taken = std::min(wanted - held_bytes_, bytes.size());
    std::copy_n(bytes.begin(), taken, held_.begin() + held_bytes_);
    held_bytes_ += taken;
    bytes = bytes.subspan(taken);
    if (!HeaderFits()) {
      const auto next = std::find(held_.begin() + 1, held_.begin() + held_bytes_, kStart[0]);
      Drop(static_cast<std::size_t>(next - held_.begin()));
    } else if (held_bytes_ < wanted) {
      return std::nullopt;
    } else if (has_header || held_[3] == 0) {
      frame_is_out_ = true;
      in_run_ = false;
      return OmniUsbFrame{.command = held_[2],
                          .payload = std::span(held_).subspan(kOmniUsbHeaderBytes, held_[3])};
    }
  }
}

// True if the bytes so far may begin a header.
bool OmniUsbParser::HeaderFits() const noexcept {
  for (std::size_t n = 0; n < std::min(held_bytes_, kStart.size()); ++n) {
    if (held_[n] != kStart[n]) return false;
  }
  return true;
}

void OmniUsbParser::Drop(std::size_t bytes) noexcept {
  corrupt_bytes_ += bytes;
  if (!in_run_) ++corrupt_runs_;
  in_run_ = true;
  std::copy(held_.begin() + bytes, held_.begin() + held_bytes_, held_.begin());
  held_bytes_ -= bytes;
}

}  // namespace palpate
