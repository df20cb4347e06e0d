// DLPack capsules of memory that a Python object owns. A consumer may let go of such memory in any
// thread, without Python's lock and when Python has ended, so what ends it is here and not in
// Python. Loaded by clients/python/heliograph/_wire/dlpack.py, into a process that has Python.
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

// Functions of Python's stable ABI that the process has; so this is compiled without a Python.
typedef struct PyObject PyObject;
extern void Py_IncRef(PyObject* object);
extern void Py_DecRef(PyObject* object);
extern int Py_IsInitialized(void);
extern int PyGILState_Ensure(void);
extern void PyGILState_Release(int state);
extern PyObject* PyErr_NoMemory(void);
extern PyObject* PyCapsule_New(void* pointer, const char* name, void (*destructor)(PyObject*));
extern int PyCapsule_IsValid(PyObject* capsule, const char* name);
extern void* PyCapsule_GetPointer(PyObject* capsule, const char* name);

// DLTensor and DLManagedTensor of dlpack.h 0.8, whose manager_ctx is the owner.
typedef struct Tensor {
  void* data;
  int32_t device_type, device_id;
  int32_t ndim;
  uint8_t code, bits;
  uint16_t lanes;
  int64_t* shape;
  int64_t* strides;
  uint64_t byte_offset;
} Tensor;
typedef struct Managed {
  Tensor tensor;
  PyObject* owner;
  void (*deleter)(struct Managed* self);
  int64_t shape[];
} Managed;

static const char kName[] = "dltensor";  // a consumer renames what it took

// Thread: any, with Python's lock or without. Python counts as not initialized as soon as it begins
// to end its modules and threads; from then on it keeps the owner, which goes with the process.
static void end(Managed* self) {
  if (Py_IsInitialized()) {
    const int state = PyGILState_Ensure();
    Py_DecRef(self->owner);
    PyGILState_Release(state);
  }
  free(self);
}

static void end_untaken(PyObject* capsule) {
  if (PyCapsule_IsValid(capsule, kName)) end(PyCapsule_GetPointer(capsule, kName));
}

/// A capsule "dltensor", version 0, of what `tensor` describes; its shape is copied. It holds a
/// reference to `owner` until the consumer that took it calls its deleter, or, taken by none, until
/// it dies itself. With Python's lock. NULL, with MemoryError set, where there is no memory.
__attribute__((visibility("default"))) PyObject* heliograph_dlpack_capsule(PyObject* owner,
                                                                           const Tensor* tensor) {
  const size_t shape_bytes = (size_t)tensor->ndim * sizeof(int64_t);
  Managed* made = malloc(sizeof(Managed) + shape_bytes);
  if (!made) return PyErr_NoMemory();
  made->tensor = *tensor;
  made->owner = owner;
  made->deleter = end;
  if (shape_bytes) memcpy(made->shape, tensor->shape, shape_bytes);
  made->tensor.shape = made->shape;
  PyObject* capsule = PyCapsule_New(made, kName, end_untaken);
  if (capsule)
    Py_IncRef(owner);
  else
    free(made);
  return capsule;
}
