#include <rubato/formula/machine_code.hpp>

#include <bit>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string>

#include <rubato/formula/assemble.hpp>
#include <rubato/formula/lazy_machine_code.hpp>

namespace rubato::formula {

const MachineCode* Bytecode::machine_code() const {
  return machine_code_ && machine_code_wanted() ? machine_code_->get(*this) : nullptr;
}

MachineCode::Function MachineCode::function() const {
  return std::bit_cast<Function>(memory_.begin() + layout_.entry);
}

MachineCode::Function MachineCode::whole() const {
  return layout_.writes_constants ? std::bit_cast<Function>(memory_.begin()) : nullptr;
}

std::unique_ptr<const MachineCode> MachineCode::compile(const Bytecode& code) {
  if (code.instructions().size() > longest_machine_code || code.output_count() > most_machine_code_outputs) {
    return nullptr;
  }
  const std::optional<Assembled> assembled = assemble(code);
  if (!assembled) {
    return nullptr;
  }
  std::optional<ExecutableMemory> memory = ExecutableMemory::with(assembled->bytes);
  if (!memory) {
    return nullptr;
  }
  const Layout layout{assembled->bytes.size(), assembled->entry, assembled->writes_constants, assembled->work_size,
                      assembled->in_loops};
  return std::make_unique<const MachineCode>(std::move(*memory), layout);
}

bool machine_code_wanted() {
  static const bool wanted = [] {
    const char* const text = std::getenv("RUBATO_JIT");
    const std::string value = text == nullptr ? "" : text;
    if (value != "" && value != "0" && value != "1") {
      throw std::invalid_argument("the environment variable RUBATO_JIT has to be 0 or 1; it is " + value);
    }
    return value != "0";
  }();
  return wanted;
}

}  // namespace rubato::formula
