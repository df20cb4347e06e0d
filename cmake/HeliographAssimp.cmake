# The readers of FBX, 3DS, 3MF, X, OFF and AMF of assimp, from its sources (scripts/assimp.py): the
# target assimp. Nothing is written, and no file is opened but through an IOSystem.
# docs/decisions/049 says why.
set(ASSIMP_SOURCE ${PROJECT_SOURCE_DIR}/.venv/assimp)
if(NOT EXISTS ${ASSIMP_SOURCE}/include/assimp/config.h.in)
  message(FATAL_ERROR "no ${ASSIMP_SOURCE}: run scripts/assimp.py")
endif()
set(ASSIMP_VERSION_MAJOR 5)
set(ASSIMP_VERSION_MINOR 4)
set(ASSIMP_VERSION_PATCH 3)
set(ASSIMP_PACKAGE_VERSION 0)
set(GIT_COMMIT_HASH 0)
foreach(header config revision)
  configure_file(${ASSIMP_SOURCE}/include/assimp/${header}.h.in
    ${PROJECT_BINARY_DIR}/assimp/assimp/${header}.h)
endforeach()

enable_language(C)  # of the library's reader of zip archives
set(ASSIMP_IMPORTERS FBX 3DS 3MF X OFF AMF)
set(assimp_patterns Common/*.cpp Geometry/*.cpp Material/*.cpp
  PostProcessing/ArmaturePopulate.cpp PostProcessing/ConvertToLHProcess.cpp
  PostProcessing/JoinVerticesProcess.cpp PostProcessing/ProcessHelper.cpp
  PostProcessing/ValidateDataStructure.cpp)
foreach(importer ${ASSIMP_IMPORTERS})
  list(APPEND assimp_patterns AssetLib/${importer}/*.cpp)
endforeach()
list(TRANSFORM assimp_patterns PREPEND ${ASSIMP_SOURCE}/code/)
file(GLOB assimp_sources CONFIGURE_DEPENDS ${assimp_patterns})

list(FILTER assimp_sources EXCLUDE REGEX "Export|/Common/Assimp.cpp")
add_library(assimp STATIC ${assimp_sources}
  ${ASSIMP_SOURCE}/contrib/unzip/ioapi.c ${ASSIMP_SOURCE}/contrib/unzip/unzip.c)

# What is not built is switched off by its own name, as the registries of the library ask; but
# ARMATUREPOPULATE, which a struct of the headers depends on.
file(STRINGS ${ASSIMP_SOURCE}/code/Common/ImporterRegistry.cpp importers
  REGEX "NO_[A-Z0-9]+_IMPORTER")
file(STRINGS ${ASSIMP_SOURCE}/code/Common/PostStepRegistry.cpp steps REGEX "NO_[A-Z_]+_PROCESS")
set(switches ${importers} ${steps})
list(TRANSFORM switches REPLACE ".*(ASSIMP_BUILD_NO_[A-Z0-9_]+_(IMPORTER|PROCESS)).*" "\\1")
list(REMOVE_DUPLICATES switches)
foreach(used ${ASSIMP_IMPORTERS})
  list(REMOVE_ITEM switches ASSIMP_BUILD_NO_${used}_IMPORTER)
endforeach()
foreach(used ARMATUREPOPULATE FLIPWINDINGORDER JOINVERTICES MAKELEFTHANDED VALIDATEDS)
  list(REMOVE_ITEM switches ASSIMP_BUILD_NO_${used}_PROCESS)
endforeach()
target_compile_definitions(assimp PRIVATE ${switches} ASSIMP_BUILD_NO_EXPORT NOUNCRYPT)
target_compile_options(assimp PRIVATE -march=x86-64-v2 -ffp-contract=off -w)
target_include_directories(assimp SYSTEM
  PUBLIC ${PROJECT_BINARY_DIR}/assimp ${ASSIMP_SOURCE}/include
  PRIVATE ${ASSIMP_SOURCE} ${ASSIMP_SOURCE}/code ${ASSIMP_SOURCE}/contrib ${ASSIMP_SOURCE}/contrib/unzip
    ${ASSIMP_SOURCE}/contrib/utf8cpp/source)
target_link_libraries(assimp PUBLIC pugixml::pugixml ZLIB::ZLIB)
