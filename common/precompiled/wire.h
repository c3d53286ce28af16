// The headers that files with gRPC parse most: see precompiled.cmake. No source includes this.
#pragma once

#include <grpcpp/grpcpp.h>

#include "common/precompiled/pure.h"
#include "palpate/v1/activity.grpc.pb.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/edit.pb.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/recording.grpc.pb.h"
#include "palpate/v1/registration.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/series.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"
