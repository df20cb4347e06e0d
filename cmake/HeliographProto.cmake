# heliograph_proto: C++ messages and stubs of proto/. Python stubs: clients/python, by scripts/setup.
function(heliograph_generate out_var root)
  set(generated)
  get_target_property(plugin gRPC::grpc_cpp_plugin LOCATION)
  foreach(file IN LISTS ARGN)
    get_filename_component(directory ${file} DIRECTORY)
    get_filename_component(stem ${file} NAME_WE)
    set(base ${PROJECT_BINARY_DIR}/generated/${directory}/${stem})
    set(outputs ${base}.pb.cc ${base}.pb.h)
    set(flags --cpp_out=${PROJECT_BINARY_DIR}/generated)
    file(STRINGS ${root}/${file} services REGEX "^service ")
    if(services)
      list(APPEND outputs ${base}.grpc.pb.cc ${base}.grpc.pb.h)
      list(APPEND flags --grpc_out=${PROJECT_BINARY_DIR}/generated --plugin=protoc-gen-grpc=${plugin})
    endif()
    add_custom_command(
      OUTPUT ${outputs}
      COMMAND ${CMAKE_COMMAND} -E make_directory ${PROJECT_BINARY_DIR}/generated
      COMMAND protobuf::protoc -I ${root} -I ${PROJECT_SOURCE_DIR}/proto ${flags} ${root}/${file}
      DEPENDS ${root}/${file}
      VERBATIM)
    list(APPEND generated ${outputs})
  endforeach()
  set(${out_var} ${generated} PARENT_SCOPE)
endfunction()

heliograph_generate(proto_sources ${PROJECT_SOURCE_DIR}/proto
  google/rpc/status.proto google/rpc/error_details.proto
  heliograph/v1/types.proto heliograph/v1/errors.proto heliograph/v1/geometry.proto heliograph/v1/material.proto
  heliograph/v1/scene.proto heliograph/v1/render.proto heliograph/v1/reading.proto
  heliograph/v1/service.proto heliograph/v1/recording.proto)
add_library(heliograph_proto STATIC ${proto_sources})
target_include_directories(heliograph_proto SYSTEM PUBLIC
  $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>)
target_link_libraries(heliograph_proto PUBLIC protobuf::libprotobuf gRPC::grpc++)
if(HELIOGRAPH_SANITIZE MATCHES thread)
  target_compile_options(heliograph_proto PUBLIC -include ${PROJECT_SOURCE_DIR}/cmake/tsan_protobuf.h)
endif()
