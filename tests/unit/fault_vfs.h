// A file layer of SQLite that fails on command and forgets what was not synced. For the tests of
// the journal.
#pragma once

#include <sqlite3.h>

#include <atomic>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <vector>

namespace heliograph::server {

/// Registered as SQLite's default for the life of the process.
class FaultVfs {
 public:
  static FaultVfs& instance() {
    static FaultVfs vfs;
    return vfs;
  }

  std::atomic<int> write_error = SQLITE_OK;  // what each write fails with
  std::atomic<int> sync_error = SQLITE_OK;
  std::atomic<bool> is_lying = false;  // a sync does nothing, and says it did

  /// The bytes of a file as a loss of power may leave them: what was synced, and of each sector of
  /// 512 bytes written since either state, as `random` says.
  [[nodiscard]] std::string after_power_loss(const std::string& path, std::mt19937& random) {
    const std::lock_guard lock(mutex_);
    const std::string now = read(path);
    std::string left = synced_[path];
    if (now.size() > left.size() && random() % 2)
      left.resize(left.size() + random() % (now.size() - left.size() + 1));
    for (std::size_t at = 0; at < left.size() && at < now.size(); at += 512)
      if (random() % 2)
        left.replace(at, std::min<std::size_t>(512, left.size() - at),
                     now.substr(at, std::min<std::size_t>(512, left.size() - at)));
    return left;
  }

 private:
  struct File {
    sqlite3_file base;
    sqlite3_file* real;
    const std::string* path;
  };
  FaultVfs() {
    real_ = sqlite3_vfs_find(nullptr);
    vfs_ = *real_;
    vfs_.zName = "faulty";
    vfs_.szOsFile = int(sizeof(File)) + real_->szOsFile;
    vfs_.xOpen = open;
    methods_ = {};
    methods_.iVersion = 1;
    methods_.xClose = [](sqlite3_file* f) {
      delete of(f).path;
      return real(f)->pMethods->xClose(real(f));
    };
    methods_.xRead = [](sqlite3_file* f, void* to, int n, sqlite3_int64 at) {
      return real(f)->pMethods->xRead(real(f), to, n, at);
    };
    methods_.xWrite = [](sqlite3_file* f, const void* from, int n, sqlite3_int64 at) {
      if (const int error = instance().write_error) return error;
      return real(f)->pMethods->xWrite(real(f), from, n, at);
    };
    methods_.xTruncate = [](sqlite3_file* f, sqlite3_int64 n) {
      return real(f)->pMethods->xTruncate(real(f), n);
    };
    methods_.xSync = sync;
    methods_.xFileSize = [](sqlite3_file* f, sqlite3_int64* n) {
      return real(f)->pMethods->xFileSize(real(f), n);
    };
    methods_.xLock = [](sqlite3_file* f, int l) { return real(f)->pMethods->xLock(real(f), l); };
    methods_.xUnlock = [](sqlite3_file* f, int l) {
      return real(f)->pMethods->xUnlock(real(f), l);
    };
    methods_.xCheckReservedLock = [](sqlite3_file* f, int* out) {
      return real(f)->pMethods->xCheckReservedLock(real(f), out);
    };
    methods_.xFileControl = [](sqlite3_file* f, int op, void* arg) {
      return real(f)->pMethods->xFileControl(real(f), op, arg);
    };
    methods_.xSectorSize = [](sqlite3_file* f) { return real(f)->pMethods->xSectorSize(real(f)); };
    methods_.xDeviceCharacteristics = [](sqlite3_file*) { return 0; };
    sqlite3_vfs_register(&vfs_, 1);
  }
  static File& of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
  static sqlite3_file* real(sqlite3_file* file) { return of(file).real; }

  static int open(sqlite3_vfs*, const char* name, sqlite3_file* file, int flags, int* out) {
    File& opened = of(file);
    opened.real = reinterpret_cast<sqlite3_file*>(&opened + 1);
    opened.base.pMethods = nullptr;
    sqlite3_vfs* below = instance().real_;
    const int code = below->xOpen(below, name, opened.real, flags, out);
    if (opened.real->pMethods == nullptr) return code;
    opened.path = new std::string(name ? name : "");
    opened.base.pMethods = &instance().methods_;
    return code;
  }
  static int sync(sqlite3_file* file, int flags) {
    FaultVfs& self = instance();
    if (const int error = self.sync_error) return error;
    if (self.is_lying) return SQLITE_OK;
    const std::lock_guard lock(self.mutex_);
    self.synced_[*of(file).path] = read(*of(file).path);
    return real(file)->pMethods->xSync(real(file), flags);
  }
  static std::string read(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  sqlite3_vfs* real_ = nullptr;
  sqlite3_vfs vfs_{};
  sqlite3_io_methods methods_{};
  std::mutex mutex_;
  std::map<std::string, std::string> synced_;
};

}  // namespace heliograph::server
