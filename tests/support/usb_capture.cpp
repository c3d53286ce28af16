#include "tests/support/usb_capture.h"

#include <pcap/pcap.h>
#include <pcap/usb.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <memory>
#include <optional>
#include <stdexcept>

namespace palpate::test {
namespace {

// One event of usbmon. Both headers begin alike, and libpcap has put the numbers into
// this machine's order.
std::optional<UsbTransfer> TransferOf(const std::uint8_t* event, std::size_t bytes,
                                      std::size_t header_bytes) {
  if (bytes < header_bytes) throw std::runtime_error("an event is shorter than its header");
  pcap_usb_header header;
  std::memcpy(&header, event, sizeof header);
  const bool in = (header.endpoint_number & URB_TRANSFER_IN) != 0;
  const bool carries = header.event_type == (in ? URB_COMPLETE : URB_SUBMIT);
  const bool is_data = header.transfer_type == URB_BULK || header.transfer_type == URB_INTERRUPT;
  if (!carries || !is_data || header.data_flag != 0 || header.data_len == 0) return std::nullopt;
  if (bytes - header_bytes < header.data_len) {
    throw std::runtime_error("its events are cut off: capture with `tcpdump -s 0`");
  }
  const std::uint8_t* data = event + header_bytes;
  return UsbTransfer{.time_s = static_cast<double>(header.ts_sec) + 1e-6 * header.ts_usec,
                     .bus = header.bus_id,
                     .device = header.device_address,
                     .endpoint = header.endpoint_number,
                     .payload = {data, data + header.data_len}};
}

// Key with the most payload.
template <class Key>
auto Busiest(const std::vector<UsbTransfer>& transfers, bool in, Key key) {
  std::map<decltype(key(transfers.front())), std::size_t> bytes;
  for (const UsbTransfer& transfer : transfers) {
    if (transfer.is_in() == in) bytes[key(transfer)] += transfer.payload.size();
  }
  const auto most = std::max_element(
      bytes.begin(), bytes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most == bytes.end() ? decltype(key(transfers.front())){} : most->first;
}

template <class Wanted>
std::vector<UsbTransfer> Those(const std::vector<UsbTransfer>& transfers, Wanted wanted) {
  std::vector<UsbTransfer> those;
  std::copy_if(transfers.begin(), transfers.end(), std::back_inserter(those), wanted);
  return those;
}

}  // namespace

std::vector<UsbTransfer> ReadUsbCapture(const std::filesystem::path& file) {
  char problem[PCAP_ERRBUF_SIZE] = "";
  const std::unique_ptr<pcap_t, decltype(&pcap_close)> capture(
      pcap_open_offline(file.c_str(), problem), pcap_close);
  if (!capture) throw std::runtime_error(problem);
  const int linktype = pcap_datalink(capture.get());
  if (linktype != DLT_USB_LINUX && linktype != DLT_USB_LINUX_MMAPPED) {
    throw std::runtime_error(file.string() + " is no capture of usbmon: its linktype is " +
                             std::to_string(linktype));
  }
  const std::size_t header_bytes =
      linktype == DLT_USB_LINUX ? sizeof(pcap_usb_header) : sizeof(pcap_usb_header_mmapped);
  std::vector<UsbTransfer> transfers;
  pcap_pkthdr* header = nullptr;
  const std::uint8_t* event = nullptr;
  int found = 0;
  while ((found = pcap_next_ex(capture.get(), &header, &event)) == 1) {
    if (auto transfer = TransferOf(event, header->caplen, header_bytes)) {
      transfers.push_back(std::move(*transfer));
    }
  }
  if (found != PCAP_ERROR_BREAK) throw std::runtime_error(pcap_geterr(capture.get()));
  return transfers;
}

std::vector<UsbTransfer> OfDevice(const std::vector<UsbTransfer>& transfers, std::uint8_t device) {
  const auto address = [](const UsbTransfer& transfer) {
    return std::pair(transfer.bus, transfer.device);
  };
  const auto busiest = Busiest(transfers, true, address);
  return Those(transfers, [&](const UsbTransfer& transfer) {
    return device != 0 ? transfer.device == device : address(transfer) == busiest;
  });
}

std::vector<UsbTransfer> OfBusiestEndpoint(const std::vector<UsbTransfer>& transfers, bool in) {
  const std::uint8_t endpoint =
      Busiest(transfers, in, [](const UsbTransfer& transfer) { return transfer.endpoint; });
  return Those(transfers, [&](const UsbTransfer& transfer) {
    return transfer.is_in() == in && transfer.endpoint == endpoint;
  });
}

std::map<std::string, int> CaptureSettings(const std::filesystem::path& capture) {
  std::map<std::string, int> settings;
  const std::filesystem::path path = std::filesystem::path(capture).replace_extension(".txt");
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    line.erase(std::min(line.find('#'), line.size()));
    std::erase_if(line, [](unsigned char c) { return std::isspace(c) != 0; });
    if (line.empty()) continue;
    const std::size_t equals = line.find('=');
    std::size_t used = 0;
    int value = 0;
    try {
      value = std::stoi(line.substr(equals + 1), &used, 0);
    } catch (const std::exception&) {
    }
    if (equals == std::string::npos || used == 0 || equals + 1 + used != line.size()) {
      throw std::runtime_error(path.string() + ": not a line like `state_command = 0x21`: " + line);
    }
    settings[line.substr(0, equals)] = value;
  }
  return settings;
}

}  // namespace palpate::test
