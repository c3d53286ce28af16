// What went over a USB bus, from a capture by Linux's usbmon (tcpdump, tshark).
//
// Threads: any. Errors: std::runtime_error for a file that is none, is cut off, or is
// of another kind of traffic.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace palpate::test {

// Data of one bulk or interrupt transfer that carried some: coming in when it was
// completed, going out when it was submitted.
struct UsbTransfer {
  double time_s = 0.0;
  std::uint16_t bus = 0;
  std::uint8_t device = 0;    // its address on the bus
  std::uint8_t endpoint = 0;  // with the direction: 0x80 and above come in
  std::vector<std::uint8_t> payload{};

  bool is_in() const { return (endpoint & 0x80) != 0; }
};

// In the order of the file, which may be pcap or pcapng; linktypes DLT_USB_LINUX and
// DLT_USB_LINUX_MMAPPED.
std::vector<UsbTransfer> ReadUsbCapture(const std::filesystem::path& file);

// Those of one device; address 0: the one that sent most.
std::vector<UsbTransfer> OfDevice(const std::vector<UsbTransfer>& transfers, std::uint8_t device);

// Those of the endpoint that carries most in one direction: a device of class CDC has
// one for notifications too.
std::vector<UsbTransfer> OfBusiestEndpoint(const std::vector<UsbTransfer>& transfers, bool in);

// "name = value" lines of the text file beside a capture (capture.pcap, capture.txt);
// # begins a comment. Values are numbers, such as 33 or 0x21. Empty without a file.
std::map<std::string, int> CaptureSettings(const std::filesystem::path& capture);

}  // namespace palpate::test
