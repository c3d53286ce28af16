#include "client/cli/upload_command.h"

#include <fmt/core.h>
#include <unistd.h>
#include <zlib.h>

#include <fstream>
#include <memory>
#include <string>

#include "client/cli/cancellable_call.h"
#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/load_command.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/interrupt/interrupt.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kChunkBytes = 1 << 20;
// What the daemon then does with it cannot be told: the rest.
constexpr double kSendingShare = 0.5;

double Mib(std::uint64_t bytes) { return static_cast<double>(bytes) / (1024.0 * 1024.0); }

std::ifstream Open(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) {
    throw Error(ErrorKind::kNotFound, file.string() + ": there is no such file");
  }
  if (!fs::is_regular_file(status)) {
    throw Error(ErrorKind::kInvalidArgument, file.string() + ": this is no file; name one");
  }
  if (access(file.c_str(), R_OK) != 0) {
    throw Error(ErrorKind::kPermissionDenied, file.string() + ": the file may not be read");
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(ErrorKind::kNotFound, file.string() + ": the file cannot be opened");
  return in;
}

// Bytes of the next chunk; none at the end.
std::size_t ReadChunk(std::ifstream& in, std::string& chunk) {
  chunk.resize(kChunkBytes);
  in.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
  chunk.resize(static_cast<std::size_t>(in.gcount()));
  if (in.bad()) throw Error(ErrorKind::kUnavailable, "the file cannot be read to its end");
  return chunk.size();
}

// Reads it once: the daemon is told size and checksum in advance.
v1::UploadVolumeStart StartOf(const fs::path& file) {
  std::ifstream in = Open(file);
  v1::UploadVolumeStart start;
  start.set_name(file.filename());
  std::uint64_t size = 0;
  uLong crc = crc32_z(0, nullptr, 0);
  for (std::string chunk; ReadChunk(in, chunk) > 0 && !Interrupt::IsRaised();) {
    size += chunk.size();
    crc = crc32_z(crc, reinterpret_cast<const Bytef*>(chunk.data()), chunk.size());
  }
  start.set_size_bytes(size);
  start.set_crc32(static_cast<std::uint32_t>(crc));
  return start;
}

class UploadCall {
 public:
  explicit UploadCall(const Connection& connection)
      : stub_(v1::VolumeService::NewStub(connection.channel())),
        call_(stub_->PrepareAsyncUploadVolume(&base_.context(), &response_, &base_.queue())) {
    call_->StartCall(&base_);
    base_.Wait();
  }
  ~UploadCall() {
    if (finished_) return;
    base_.context().TryCancel();
    Finish();
  }
  UploadCall(const UploadCall&) = delete;
  UploadCall& operator=(const UploadCall&) = delete;

  // False when the daemon wants no more.
  bool Write(const v1::UploadVolumeRequest& message) {
    call_->Write(message, &base_);
    return base_.Wait();
  }
  void WritesDone() {
    call_->WritesDone(&base_);
    base_.Wait();
  }
  grpc::Status Finish() {
    finished_ = true;
    return base_.Finish(*call_);
  }
  const v1::UploadVolumeResponse& response() const { return response_; }

 private:
  CancellableCall base_;
  bool finished_ = false;
  v1::UploadVolumeResponse response_;
  std::unique_ptr<v1::VolumeService::Stub> stub_;
  std::unique_ptr<grpc::ClientAsyncWriter<v1::UploadVolumeRequest>> call_;
};

void SendData(std::ifstream& in, std::uint64_t size_bytes, ProgressPrinter& printer,
              UploadCall& call) {
  v1::UploadVolumeRequest message;
  for (std::uint64_t sent = 0; ReadChunk(in, *message.mutable_data()) > 0;) {
    sent += message.data().size();
    if (!call.Write(message)) return;
    printer.Print("sending",
                  kSendingShare * static_cast<double>(sent) / static_cast<double>(size_bytes),
                  fmt::format("{:.1f} of {:.1f} MiB", Mib(sent), Mib(size_bytes)));
  }
  call.WritesDone();
  printer.Print("loading", kSendingShare);
}

}  // namespace

void UploadVolume(const Connection& connection, const fs::path& file,
                  const v1::LoadVolumeRequest& options) {
  const Interrupt interrupt;
  v1::UploadVolumeRequest message;
  *message.mutable_start() = StartOf(file);
  *message.mutable_start()->mutable_options() = options;
  const std::uint64_t size_bytes = message.start().size_bytes();
  std::ifstream in = Open(file);
  UploadCall call(connection);
  {
    ProgressPrinter printer;
    if (call.Write(message)) SendData(in, size_bytes, printer, call);
    if (const grpc::Status status = call.Finish(); !status.ok()) {
      throw ErrorOfLoad(connection, status);
    }
  }
  const v1::UploadVolumeResponse& response = call.response();
  PrintWarnings(response.volume());
  WriteOutput(Describe(response.volume()) +
              fmt::format("applied at tick {}, settings revision {}\n", response.applied_tick(),
                          response.settings_revision()));
}

}  // namespace palpate::cli
