// VolumeService.StreamVolume: one reactor per subscriber, with one write
// outstanding.
//
// Threads: gRPC's bring requests and end writes; the streams' thread starts
// writes. Nothing here blocks.
// Ownership: the streams hold a reactor by weak_ptr; it holds itself until gRPC is
// done with it.
#pragma once

#include <grpcpp/support/server_callback.h>

#include "palpate/v1/volume_stream.pb.h"
#include "server/rpc/access.h"
#include "server/streaming/volume_streams.h"

namespace palpate {

using VolumeStreamReactor =
    grpc::ServerBidiReactor<v1::StreamVolumeRequest, v1::StreamVolumeResponse>;

// Borrows the streams, which are to outlive the server.
VolumeStreamReactor* StreamVolumeTo(VolumeStreams& streams, Admission admission);

}  // namespace palpate
