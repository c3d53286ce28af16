# Gives palpate::client. Includes are written from the folder that it brings along:
# #include "client/sdk/client.h".
include(CMakeFindDependencyMacro)
find_dependency(Eigen3 NO_MODULE)
# What the static library is linked with; no header of it shows them.
find_dependency(Protobuf MODULE)
find_dependency(gRPC CONFIG)
find_dependency(tomlplusplus)
find_dependency(ZLIB)
find_dependency(PkgConfig)
pkg_check_modules(XXHASH REQUIRED QUIET IMPORTED_TARGET libxxhash)
pkg_check_modules(ZSTD REQUIRED QUIET IMPORTED_TARGET libzstd)
include(${CMAKE_CURRENT_LIST_DIR}/palpate-client-targets.cmake)
