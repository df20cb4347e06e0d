# The part of OpenVDB that reads grids, from its sources (scripts/openvdb.py): the targets openvdb and
# nanovdb. Without threads before main, mapped files and points. docs/decisions/048 says why.
set(OPENVDB_SOURCE ${PROJECT_SOURCE_DIR}/.venv/openvdb)
if(NOT EXISTS ${OPENVDB_SOURCE}/openvdb/version.h.in)
  message(FATAL_ERROR "no ${OPENVDB_SOURCE}: run scripts/openvdb.py")
endif()
set(OpenVDB_MAJOR_VERSION 10)
set(OpenVDB_MINOR_VERSION 0)
set(OpenVDB_PATCH_VERSION 1)
set(OPENVDB_ABI_VERSION_NUMBER 10)
set(OPENVDB_PACKED_VERSION 0x0A000001)
set(OPENVDB_USE_BLOSC ON)
set(OPENVDB_USE_ZLIB ON)
configure_file(${OPENVDB_SOURCE}/openvdb/version.h.in
  ${PROJECT_BINARY_DIR}/openvdb/openvdb/version.h)

set(openvdb_sources Grid Metadata MetaMap Platform io/Archive io/Compression io/DelayedLoadMetadata
  io/GridDescriptor math/Half math/Maps math/Transform points/StreamCompression util/Formats
  util/Util)
list(TRANSFORM openvdb_sources PREPEND ${OPENVDB_SOURCE}/openvdb/)
list(TRANSFORM openvdb_sources APPEND .cc)
add_library(openvdb STATIC ${openvdb_sources})
target_compile_options(openvdb PRIVATE -march=x86-64-v2 -ffp-contract=off -w)
target_compile_definitions(openvdb PUBLIC OPENVDB_STATICLIB)
target_include_directories(openvdb SYSTEM PUBLIC
  ${PROJECT_BINARY_DIR}/openvdb ${PROJECT_BINARY_DIR}/openvdb/openvdb ${OPENVDB_SOURCE})
target_link_libraries(openvdb PUBLIC TBB::tbb Boost::headers ZLIB::ZLIB ${BLOSC_LIBRARY})

add_library(nanovdb INTERFACE)
target_include_directories(nanovdb SYSTEM INTERFACE ${OPENVDB_SOURCE})
target_compile_definitions(nanovdb INTERFACE NANOVDB_USE_ZIP NANOVDB_USE_BLOSC)
target_link_libraries(nanovdb INTERFACE ZLIB::ZLIB ${BLOSC_LIBRARY})
