// Loaded before the C library: a file system as unkind as POSIX allows, when the machine stops right after a file got
// its name. Names reach the disk at once, contents only when fsync has waited for them. For every record that gets its
// name two images of what would be found are written into $RUBATO_CRASH_IMAGES: in one all that was not waited for is
// lost, in the other a random half of it, block by block. A third one is of a machine that stops just before fsync of
// the folder has waited for the name: the old name is back, and the space of what it leads to has gone to others if
// nobody had it open any more (ext4 with data=writeback does that).

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include <dlfcn.h>
#include <sys/stat.h>

namespace {

template <typename Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

std::string image_folder() {
  const char* const folder = std::getenv("RUBATO_CRASH_IMAGES");
  return folder == nullptr ? "" : std::string(folder) + "/";
}

std::string contents(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Where the contents of a file are kept that fsync has waited for.
std::string synced(const struct stat& status) {
  return image_folder() + "synced-" + std::to_string(status.st_ino);
}

void forget(const char* file) {
  struct stat status {};
  if (stat(file, &status) == 0)
    std::remove(synced(status).c_str());
}

std::string images_of(int number) {
  return image_folder() + "image-" + std::to_string(number);
}

int number = 0;  // of files that got the name of a record

/// What has lost its name since the last fsync of the folder.
struct Replaced {
  ino_t file = 0;
  std::string kept;
} replaced;

void remember_replaced(const char* file) {
  struct stat status {};
  if (!image_folder().empty() && stat(file, &status) == 0)
    replaced = {status.st_ino, contents(synced(status))};
}

bool is_open(ino_t file) {
  constexpr int most = 1024;
  struct stat status {};
  for (int descriptor = 0; descriptor < most; ++descriptor)
    if (fstat(descriptor, &status) == 0 && status.st_ino == file)
      return true;
  return false;
}

void write_image_of_replaced() {
  if (replaced.file == 0)
    return;
  // Before the image is made, which may get the number of a file that is gone.
  const std::string found = is_open(replaced.file) ? replaced.kept : std::string(replaced.kept.size(), 'x');
  std::ofstream(images_of(number) + "-back.h5", std::ios::binary) << found;
  replaced = {};
}

void write_images(const char* file, const std::string& name) {
  struct stat status {};
  if (image_folder().empty() || !name.ends_with(".h5") || stat(file, &status) != 0)
    return;
  static std::mt19937 random(20261121);
  const std::string now = contents(file), kept = contents(synced(status));
  const std::string image = images_of(++number);
  std::ofstream(image + "-lost.h5", std::ios::binary) << kept;
  std::string torn = now;
  constexpr std::size_t block = 4096;
  for (std::size_t first = 0; first < torn.size(); first += block)
    if (random() % 2 == 0)
      for (std::size_t i = first; i < std::min(first + block, torn.size()); ++i)
        torn[i] = i < kept.size() ? kept[i] : '\0';
  std::ofstream(image + "-torn.h5", std::ios::binary) << torn;
}

}  // namespace

extern "C" {

int fsync(int descriptor) {
  struct stat status {};
  if (!image_folder().empty() && fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode))
    std::ofstream(synced(status), std::ios::binary) << contents("/proc/self/fd/" + std::to_string(descriptor));
  if (!image_folder().empty() && fstat(descriptor, &status) == 0 && S_ISDIR(status.st_mode))
    write_image_of_replaced();
  return real<int (*)(int)>("fsync")(descriptor);
}

int rename(const char* from, const char* to) noexcept {
  write_images(from, to);
  remember_replaced(to);
  forget(to);
  return real<int (*)(const char*, const char*)>("rename")(from, to);
}

int renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) noexcept {
  write_images(from, to);
  return real<int (*)(int, const char*, int, const char*, unsigned)>("renameat2")(from_folder, from, to_folder, to,
                                                                                  flags);
}

int unlink(const char* file) noexcept {
  forget(file);
  return real<int (*)(const char*)>("unlink")(file);
}
}
