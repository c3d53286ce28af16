// Captures of real devices, decoded: of a Touch those in tests/data/captures/omni-usb/ and in
// $PALPATE_CAPTURES/omni-usb/, of an Omni on FireWire those in tests/data/captures/omni-firewire/.
// deploy/guides/devices.md says how they are made, and what they prove. A synthetic capture,
// written here, proves that this test can tell.
#include <gtest/gtest.h>
#include <pcap/pcap.h>
#include <pcap/usb.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <sstream>

#include "server/device/omni/omni_arm.h"
#include "tests/support/omni_frames.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Settings = std::map<std::string, int>;
using CapturePath = std::filesystem::path;

// Incoming data at completion, outgoing data at submission, of a bulk or interrupt transfer.
struct CapturedTransfer {
  double time_s = 0.0;
  int device = 0;    // its address on the bus
  int endpoint = 0;  // with the direction: 0x80 and above come in
  Bytes payload{};
};
using Transfers = std::vector<CapturedTransfer>;

// Both headers of usbmon begin alike, and libpcap has put the numbers into this machine's order.
std::optional<CapturedTransfer> TransferOf(std::span<const std::uint8_t> event,
                                           std::size_t header_bytes) {
  if (event.size() < header_bytes) throw std::runtime_error("an event without its header");
  pcap_usb_header header;
  std::memcpy(&header, event.data(), sizeof header);
  const bool in = (header.endpoint_number & URB_TRANSFER_IN) != 0;
  const bool carries = header.event_type == (in ? URB_COMPLETE : URB_SUBMIT);
  const bool is_data = header.transfer_type == URB_BULK || header.transfer_type == URB_INTERRUPT;
  if (!carries || !is_data || header.data_flag != 0 || header.data_len == 0) return std::nullopt;
  event = event.subspan(header_bytes);
  if (event.size() < header.data_len) {
    throw std::runtime_error("its events are cut off: capture with `tcpdump -s 0`");
  }
  return CapturedTransfer{.time_s = static_cast<double>(header.ts_sec) + 1e-6 * header.ts_usec,
                          .device = header.device_address,
                          .endpoint = header.endpoint_number,
                          .payload = {event.begin(), event.begin() + header.data_len}};
}

// A pcap or pcapng file of Linux's usbmon.
Transfers ReadCapture(const CapturePath& file) {
  char problem[PCAP_ERRBUF_SIZE] = "";
  const std::unique_ptr<pcap_t, decltype(&pcap_close)> capture(
      pcap_open_offline(file.c_str(), problem), pcap_close);
  if (!capture) throw std::runtime_error(problem);
  const int linktype = pcap_datalink(capture.get());
  if (linktype != DLT_USB_LINUX && linktype != DLT_USB_LINUX_MMAPPED) {
    throw std::runtime_error(file.string() + " is no capture of usbmon");
  }
  const std::size_t header_bytes =
      linktype == DLT_USB_LINUX ? sizeof(pcap_usb_header) : sizeof(pcap_usb_header_mmapped);
  Transfers transfers;
  pcap_pkthdr* header = nullptr;
  const std::uint8_t* event = nullptr;
  int found = 0;
  while ((found = pcap_next_ex(capture.get(), &header, &event)) == 1) {
    auto transfer = TransferOf({event, header->caplen}, header_bytes);
    if (transfer) transfers.push_back(std::move(*transfer));
  }
  if (found != PCAP_ERROR_BREAK) throw std::runtime_error(pcap_geterr(capture.get()));
  return transfers;
}

// Those whose device or endpoint is `wanted`; 0: the one that carries most in this direction.
Transfers Only(const Transfers& transfers, bool in, int CapturedTransfer::*of, int wanted = 0) {
  std::map<int, std::size_t> bytes;
  for (const CapturedTransfer& transfer : transfers) {
    if ((transfer.endpoint >= 0x80) == in) bytes[transfer.*of] += transfer.payload.size();
  }
  std::size_t most = 0;
  for (const auto& [key, count] : bytes) {
    if (wanted == 0 || (most > 0 && count > most)) {
      wanted = key;
      most = count;
    }
  }
  Transfers those;
  std::ranges::copy_if(transfers, std::back_inserter(those),
                       [&](const auto& transfer) { return transfer.*of == wanted; });
  return those;
}

// The text file beside a capture has lines "name = value". # begins a comment.
Settings ReadSettings(const CapturePath& capture) {
  Settings settings;
  std::ifstream file(CapturePath(capture).replace_extension(".txt"));
  for (std::string line; std::getline(file, line);) {
    line.erase(std::min(line.find('#'), line.size()));
    const std::size_t equals = line.find('=');
    std::string name;
    if (!(std::istringstream(line.substr(0, equals)) >> name)) continue;
    if (equals == std::string::npos) throw std::runtime_error("no value: " + line);
    settings[name] = std::stoi(line.substr(equals + 1), nullptr, 0);
  }
  return settings;
}

// Which frames there are, of what length and how often: "in 0x21: 44 bytes, 1000/s".
std::string FrameTable(const Transfers& transfers, const char* direction) {
  std::map<std::pair<int, std::size_t>, int> counts;
  OmniUsbParser parser;
  for (const CapturedTransfer& transfer : transfers) {
    std::span<const std::uint8_t> bytes = transfer.payload;
    while (const auto frame = parser.Next(bytes)) ++counts[{frame->command, frame->payload.size()}];
  }
  const double time_s =
      transfers.empty() ? 0.0 : transfers.back().time_s - transfers.front().time_s;
  std::ostringstream table;
  for (const auto& [frame, count] : counts) {
    table << "  " << direction << " 0x" << std::hex << frame.first << std::dec << ": "
          << frame.second << " bytes, " << count << " times";
    if (time_s > 0.0) table << ", " << std::lround(count / time_s) << "/s";
    table << "\n";
  }
  return table.str();
}

bool AreMost(std::size_t part, std::size_t all) { return part >= 0.99 * all; }

constexpr const char* kNoFrames = "over 1 % of the bytes are in no frame";

// "": none.
std::string ProblemOf(const Transfers& in) {
  OmniUsbParser parser;
  std::size_t in_bytes = 0;
  for (const CapturedTransfer& transfer : in) {
    in_bytes += transfer.payload.size();
    std::span<const std::uint8_t> bytes = transfer.payload;
    while (parser.Next(bytes)) {
    }
  }
  if (in_bytes == 0) return "nothing came in";
  return AreMost(in_bytes - parser.corrupt_bytes(), in_bytes) ? "" : kNoFrames;
}

struct Judgement {
  std::string problem{};  // "": none
  std::string frames{};   // for whoever looks for command bytes
};

Judgement Judge(const CapturePath& file) {
  Settings settings = ReadSettings(file);
  const Transfers transfers =
      Only(ReadCapture(file), true, &CapturedTransfer::device, settings["device"]);
  const Transfers in = Only(transfers, true, &CapturedTransfer::endpoint);
  const Transfers out = Only(transfers, false, &CapturedTransfer::endpoint);
  return {.problem = ProblemOf(in), .frames = FrameTable(in, "in ") + FrameTable(out, "out")};
}

TEST(Captures, OfRealDevicesAreDecoded) {
  std::vector<CapturePath> roots = {test::kCaptures};
  if (const char* folder = std::getenv("PALPATE_CAPTURES")) roots.emplace_back(folder);
  int count = 0;
  for (const CapturePath& root : roots) {
    if (!std::filesystem::is_directory(root / "omni-usb")) continue;
    for (const auto& entry : std::filesystem::directory_iterator(root / "omni-usb")) {
      const CapturePath& file = entry.path();
      if (file.extension() != ".pcap" && file.extension() != ".pcapng") continue;
      ++count;
      const Judgement judgement = Judge(file);
      std::cout << file.string() << "\n" << judgement.frames;
      EXPECT_EQ(judgement.problem, "") << file;
    }
  }
  if (count == 0) GTEST_SKIP() << "there are none yet";
}

// Packets of a FireWire Omni, a line of bytes in hex for each: lines of palpated's log will do.
// Returns what is wrong.
std::string ProblemOfPackets(std::istream& lines) {
  OmniArm arm;
  DeviceState state;
  int packets = 0;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line.substr(line.rfind(':') + 1));
    Bytes bytes;
    for (unsigned byte = 0; words >> std::hex >> byte;) {
      bytes.push_back(static_cast<std::uint8_t>(byte));
    }
    const auto reading = DecodeOmniState(bytes);
    if (!reading) return "no state: " + line;
    arm.Take(*reading, state);
    if (!(state.p_MHip_mm.norm() < 600.0)) return "out of reach: " + line;
    ++packets;
  }
  return packets > 0 ? "" : "no packets";
}

TEST(Captures, PacketsOfAnOmniAreReplayed) {
  std::istringstream ours(
      "omni-firewire: its first packet: 00 00 1e 00 10 00 f0 ff 20 00 00 02 00 02 00 02 00 00 00 "
      "07 "
      "07 10 00 02 00 02 00 02 46 57 00 00 78 56 34 12 00 00 00 00 00 00 00 00\n");
  EXPECT_EQ(ProblemOfPackets(ours), "");
  std::istringstream cut("00 00 1e 00 10 00\n");
  EXPECT_NE(ProblemOfPackets(cut), "");
}

TEST(Captures, OfARealOmniAreReplayed) {
  const CapturePath folder = CapturePath(test::kCaptures) / "omni-firewire";
  if (!std::filesystem::is_directory(folder)) GTEST_SKIP() << "there are none yet";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::ifstream file(entry.path());
    EXPECT_EQ(ProblemOfPackets(file), "") << entry.path();
  }
}

// Writes events as usbmon does.
class CaptureWriter {
 public:
  explicit CaptureWriter(const CapturePath& file)
      : capture_(pcap_open_dead(DLT_USB_LINUX_MMAPPED, 65535)),
        dumper_(pcap_dump_open(capture_, file.c_str())) {
    if (!dumper_) throw std::runtime_error(pcap_geterr(capture_));
  }
  ~CaptureWriter() {
    pcap_dump_close(dumper_);
    pcap_close(capture_);
  }
  CaptureWriter(const CaptureWriter&) = delete;
  CaptureWriter& operator=(const CaptureWriter&) = delete;

  // Both events of one transfer, a ms after the last.
  void Transfer(std::uint8_t device, std::uint8_t endpoint, const Bytes& payload,
                std::uint8_t type = URB_BULK) {
    pcap_usb_header_mmapped header{};
    header.transfer_type = type;
    header.endpoint_number = endpoint;
    header.device_address = device;
    header.ts_sec = time_ms_ / 1000;
    header.ts_usec = static_cast<std::int32_t>(1000 * (time_ms_++ % 1000));
    for (const char event : {URB_SUBMIT, URB_COMPLETE}) {
      const bool carries = (event == URB_COMPLETE) == (endpoint >= 0x80);
      header.event_type = static_cast<std::uint8_t>(event);
      header.data_flag = carries ? 0 : '<';
      header.data_len = carries ? static_cast<std::uint32_t>(payload.size()) : 0;
      Bytes bytes(sizeof header + header.data_len);
      std::memcpy(bytes.data(), &header, sizeof header);
      std::copy_n(payload.begin(), header.data_len, bytes.begin() + sizeof header);
      pcap_pkthdr packet{};
      packet.caplen = packet.len = static_cast<std::uint32_t>(bytes.size());
      pcap_dump(reinterpret_cast<u_char*>(dumper_), &packet, bytes.data());
    }
  }

 private:
  pcap_t* capture_;
  pcap_dumper_t* dumper_;
  long time_ms_ = 0;
};

class SyntheticCapture : public ::testing::Test {
 protected:
  // Three seconds of 44 bytes in and 16 bytes out, in transfers of 64 bytes, among other traffic.
  void Write(bool garbage_between_frames) {
    CaptureWriter writer(file_);
    Bytes stream;
    for (int n = 0; n < 3000; ++n) {
      const Bytes frame = test::Framed(0x21, Bytes(44, static_cast<std::uint8_t>(n)));
      stream.insert(stream.end(), frame.begin(), frame.end());
      if (garbage_between_frames) stream.push_back(0x11);
      while (stream.size() >= 64) {
        writer.Transfer(5, 0x82, Bytes(stream.begin(), stream.begin() + 64));
        stream.erase(stream.begin(), stream.begin() + 64);
      }
      writer.Transfer(5, 0x03, test::Framed(0x22, Bytes(16, 0)));
      if (n % 10 != 0) continue;
      writer.Transfer(5, 0x81, {0xa1, 0x20}, URB_INTERRUPT);
      writer.Transfer(5, 0x00, {1, 2, 3}, URB_CONTROL);
      writer.Transfer(9, 0x81, Bytes(300, 0xee));  // another device
    }
  }
  void WriteSettings(const char* text) { std::ofstream(folder_.path() / "touch.txt") << text; }

  const test::TemporaryFolder folder_{};
  const CapturePath file_ = folder_.path() / "touch.pcap";
};

TEST_F(SyntheticCapture, BytesBetweenFramesAreSeen) {
  WriteSettings("# synthetic\n\ndevice=5\n");
  Write(true);
  EXPECT_EQ(Judge(file_).problem, kNoFrames);
}

TEST_F(SyntheticCapture, ItsFramesAreListedOnce) {
  Write(false);
  const Judgement judgement = Judge(file_);
  EXPECT_EQ(judgement.problem, "");
  EXPECT_NE(judgement.frames.find("in  0x21: 44 bytes, "), std::string::npos);
  EXPECT_NE(judgement.frames.find("out 0x22: 16 bytes, 3000 times"), std::string::npos)
      << judgement.frames;
}

}  // namespace
}  // namespace palpate
