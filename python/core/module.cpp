#include "core.hpp"

#include <cstdio>

#include <rubato/formula/parse.hpp>

namespace rubato::python {

namespace {

/// That of the run in the main thread; null where there is none.
std::atomic<std::atomic<bool>*> interrupt_flag = nullptr;
unsigned long main_thread = 0;

extern "C" void on_interrupt(int /*number*/) {
  if (std::atomic<bool>* const flag = interrupt_flag) {
    *flag = true;
  }
}

}  // namespace

CatchInterrupt::CatchInterrupt() {
  struct sigaction present = {};
  if (PyThread_get_thread_ident() != main_thread || sigaction(SIGINT, nullptr, &present) != 0 ||
      present.sa_handler == SIG_IGN) {
    return;
  }
  interrupt_flag = &asked_;
  struct sigaction action = {};
  action.sa_handler = &on_interrupt;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  before_ = present;
}

CatchInterrupt::~CatchInterrupt() {
  if (before_) {
    sigaction(SIGINT, &*before_, nullptr);
    interrupt_flag = nullptr;
  }
}

}  // namespace rubato::python

/// In place of stderr, for the asmjit that this module links (CMakeLists.txt).
extern "C" [[gnu::visibility("hidden")]] FILE* rubato_asmjit_stderr;
FILE* rubato_asmjit_stderr = stderr;

PYBIND11_MODULE(_core, module) {
  using namespace rubato::python;
  module.doc() = "The C++ library, for the package rubato. Use that.";
  module.attr("version") = std::string(rubato::version());
  main_thread = py::module_::import("threading").attr("main_thread")().attr("ident").cast<unsigned long>();
  const auto describe = [](py::object error, const char* words) {
    error.attr("__module__") = "rubato";
    error.attr("__doc__") = words;
    return error;
  };
  describe(py::register_exception<rubato::ProblemError>(module, "ProblemError", PyExc_ValueError),
           "Something in a problem is wrong: the text says where, and what to do.");
  describe(py::register_exception<rubato::FileError>(module, "FileError", PyExc_OSError),
           "A file could not be read or written.");
  const py::object record_error =
      describe(py::register_exception<rubato::record::Error>(module, "RecordError", PyExc_OSError),
               "A record could not be read or written.");
  describe(py::register_exception<rubato::record::AlreadyExists>(
               module, "RecordExists", py::make_tuple(record_error, py::handle(PyExc_FileExistsError))),
           "A record is where a new one was to be written; overwrite=True replaces it.");
  define_many(module);
  define_problems(module);
  define_records(module);
  define_runs(module);
  define_steps(module);
}
