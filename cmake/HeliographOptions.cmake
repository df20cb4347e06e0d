# Compiler settings that every target shares: heliograph_options.
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_STANDARD 23)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_FLAGS_RELEASE "-O3 -DNDEBUG")

# Paths beneath the sources count as relative, so that checkouts share what they compiled.
find_program(CCACHE ccache)
if(CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER
    ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} CCACHE_NOHASHDIR=1 ${CCACHE})
endif()

add_library(heliograph_options INTERFACE)
target_include_directories(heliograph_options INTERFACE ${PROJECT_SOURCE_DIR})
# No contraction and no fast-math: the same expression gives the same bits everywhere.
target_compile_options(heliograph_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Werror=switch -Werror
  -Wno-missing-field-initializers -march=x86-64-v2 -ffp-contract=off)
target_compile_definitions(heliograph_options INTERFACE GLM_FORCE_INLINE)
# g++ 12 sees uninitialised values in the standard library once it is instrumented.
if(HELIOGRAPH_SANITIZE)
  target_compile_options(heliograph_options INTERFACE
    -fsanitize=${HELIOGRAPH_SANITIZE} -fno-omit-frame-pointer -Wno-maybe-uninitialized)
  target_link_options(heliograph_options INTERFACE -fsanitize=${HELIOGRAPH_SANITIZE})
endif()
