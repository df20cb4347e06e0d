# Third-party libraries. Minimum versions are those of Debian 12.
find_package(Threads REQUIRED)
find_package(OpenSSL REQUIRED)
find_package(Protobuf REQUIRED)
find_package(gRPC 1.51 CONFIG REQUIRED)
if(NOT HELIOGRAPH_DAEMON)
  set(HELIOGRAPH_TESTS OFF)  # they need a daemon
  return()
endif()

find_package(glm REQUIRED)
find_package(fmt REQUIRED)
find_package(spdlog 1.10 REQUIRED)
find_package(TBB REQUIRED)
find_package(CLI11 REQUIRED)
find_package(prometheus-cpp CONFIG REQUIRED)
find_package(SQLite3 3.40 REQUIRED)

find_package(embree 4 QUIET)
if(NOT embree_FOUND)
  find_package(embree 3 REQUIRED)
endif()

find_library(SECCOMP_LIBRARY seccomp REQUIRED)
find_library(JEMALLOC_LIBRARY jemalloc REQUIRED)

# The codecs of heliograph-decode.
find_package(nlohmann_json REQUIRED)
find_package(pugixml REQUIRED)
find_package(ZLIB REQUIRED)
find_library(BLOSC_LIBRARY blosc REQUIRED)
find_library(DRACO_LIBRARY libdraco.a REQUIRED)  # 0.8 MB of it are used; 2.8 MB as a shared one
find_package(meshoptimizer REQUIRED)
find_package(Boost REQUIRED)  # headers, for OpenVDB
include(HeliographAssimp)
include(HeliographOpenvdb)
# scripts/openimageio.py puts it there; distributions have it without formats that people use.
set(openimageio ${PROJECT_SOURCE_DIR}/.venv/openimageio)
find_path(OPENIMAGEIO_INCLUDE OpenImageIO/imageio.h HINTS ${openimageio}/include REQUIRED)
find_library(OPENIMAGEIO_LIBRARY OpenImageIO HINTS ${openimageio}/lib REQUIRED)
find_library(OPENIMAGEIO_UTIL_LIBRARY OpenImageIO_Util HINTS ${openimageio}/lib REQUIRED)
add_library(openimageio INTERFACE)
target_include_directories(openimageio SYSTEM INTERFACE ${OPENIMAGEIO_INCLUDE})
target_link_libraries(openimageio INTERFACE ${OPENIMAGEIO_LIBRARY} ${OPENIMAGEIO_UTIL_LIBRARY})
# scripts/basis_universal.py puts it there. Of the formats that GPUs take none is written.
set(basis_universal ${PROJECT_SOURCE_DIR}/.venv/basis_universal)
find_path(BASIS_UNIVERSAL_SOURCE basisu_transcoder.cpp HINTS ${basis_universal}/transcoder REQUIRED)
find_library(ZSTD_LIBRARY zstd REQUIRED)
add_library(basis_universal STATIC ${BASIS_UNIVERSAL_SOURCE}/basisu_transcoder.cpp)
target_include_directories(basis_universal SYSTEM PUBLIC ${BASIS_UNIVERSAL_SOURCE})
foreach(target ASTC DXT1 DXT5A BC7_MODE5 PVRTC1 PVRTC2 ETC2_EAC_A8 ETC2_EAC_RG11 ATC FXT1)
  target_compile_definitions(basis_universal PRIVATE BASISD_SUPPORT_${target}=0)
endforeach()
target_compile_options(basis_universal PRIVATE -w -fno-strict-aliasing)
target_link_libraries(basis_universal PUBLIC ${ZSTD_LIBRARY})

if(HELIOGRAPH_TESTS)
  find_package(Catch2 REQUIRED)
endif()
if(HELIOGRAPH_CUDA)
  find_program(NVCC nvcc PATHS /usr/local/cuda/bin)
endif()
