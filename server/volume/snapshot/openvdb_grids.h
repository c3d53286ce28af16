// OpenVDB with its usual grids of numbers, to be included instead of <openvdb/openvdb.h>.
//
// A grid's class is virtual: each file that uses it would compile all of it and everything that it
// calls, for up to two minutes. OpenVDB's library holds their virtual functions compiled, since it
// reads such grids from files. So these classes are declared as compiled elsewhere, but only where
// gcc optimises and no sanitizer is on: the functions that the library lacks must be inlined.
#pragma once

#include <openvdb/openvdb.h>

#if defined(__OPTIMIZE__) && !defined(__clang__) && !defined(PALPATE_SANITIZED)

// PALPATE_FOR_EACH_OPENVDB_TREE(F): F(Tree) for the tree of each such grid.
#define PALPATE_FOR_EACH_OPENVDB_TREE(F) \
  F(BoolTree)                            \
  F(Int32Tree)                           \
  F(Int64Tree)                           \
  F(FloatTree)                           \
  F(DoubleTree)

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {

#define PALPATE_COMPILED_ELSEWHERE(T) \
  extern template class Grid<T>;      \
  extern template class tree::Tree<T::RootNodeType>;
PALPATE_FOR_EACH_OPENVDB_TREE(PALPATE_COMPILED_ELSEWHERE)
#undef PALPATE_COMPILED_ELSEWHERE

}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb

#endif
