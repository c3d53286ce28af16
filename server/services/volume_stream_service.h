// VolumeService.StreamVolume: one reactor per subscriber, with at most one write in progress.
//
// Threads: gRPC's threads deliver requests and finish writes; the streams' thread starts writes. No
// thread blocks here.
// Ownership: the streams hold a reactor by weak_ptr. A reactor holds itself until gRPC has finished
// with it.
#pragma once

#include <grpcpp/support/server_callback.h>

#include "palpate/v1/volume_stream.pb.h"
#include "server/door/access.h"
#include "server/volume_stream/volume_streams.h"

namespace palpate {

using VolumeStreamReactor =
    grpc::ServerBidiReactor<v1::StreamVolumeRequest, v1::StreamVolumeResponse>;

// Borrows the streams. They must outlive the server.
VolumeStreamReactor* StreamVolumeTo(VolumeStreams& streams, Admission admission);

}  // namespace palpate
