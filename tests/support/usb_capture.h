// Reads the traffic of a USB bus from a capture by Linux's usbmon (tcpdump, tshark).
//
// Threads: any. Errors: std::runtime_error for a file that is not a capture, is cut off, or has
// another kind of traffic.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace palpate::test {

// The data of one bulk or interrupt transfer with data: incoming data at completion, outgoing data
// at submission.
struct UsbTransfer {
  double time_s = 0.0;
  std::uint16_t bus = 0;
  std::uint8_t device = 0;    // its address on the bus
  std::uint8_t endpoint = 0;  // with the direction: 0x80 and above come in
  std::vector<std::uint8_t> payload{};

  bool is_in() const { return (endpoint & 0x80) != 0; }
};

// Returns transfers in the order of the file. The file may be pcap or pcapng, with linktypes
// DLT_USB_LINUX and DLT_USB_LINUX_MMAPPED.
std::vector<UsbTransfer> ReadUsbCapture(const std::filesystem::path& file);

// Returns the transfers of one device. Address 0: the device that sent most.
std::vector<UsbTransfer> OfDevice(const std::vector<UsbTransfer>& transfers, std::uint8_t device);

// Returns the transfers of the endpoint that carries most in one direction. A CDC device also has
// an endpoint for notifications.
std::vector<UsbTransfer> OfBusiestEndpoint(const std::vector<UsbTransfer>& transfers, bool in);

// Reads "name = value" lines from the text file beside a capture (capture.pcap, capture.txt). #
// begins a comment. Values are numbers such as 33 or 0x21. Empty if there is no file.
std::map<std::string, int> CaptureSettings(const std::filesystem::path& capture);

}  // namespace palpate::test
