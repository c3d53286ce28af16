#include "server/volume/openvdb_grids.h"

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {

#define PALPATE_COMPILED_HERE(T) \
  template class Grid<T>;        \
  template class tree::Tree<T::RootNodeType>;
PALPATE_FOR_EACH_OPENVDB_TREE(PALPATE_COMPILED_HERE)
#undef PALPATE_COMPILED_HERE

}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb
