#pragma once

#include <memory>
#include <mutex>

#include <rubato/formula/batch_program.hpp>
#include <rubato/formula/machine_code.hpp>

namespace rubato::formula {

/// What the copies of a Bytecode share: its machine code, compiled at the first call by whichever thread comes first.
class LazyMachineCode {
public:
  const MachineCode* get(const Bytecode& code) {
    std::call_once(once_, [&] { machine_code_ = MachineCode::compile(code); });
    return machine_code_.get();
  }
  /// For batches, as many lanes as the process uses.
  const std::shared_ptr<const BatchProgram>& batch(const Bytecode& code, int lanes) {
    std::call_once(batch_once_, [&] { batch_ = BatchProgram::compile(code, lanes); });
    return batch_;
  }

private:
  std::once_flag once_, batch_once_;
  std::unique_ptr<const MachineCode> machine_code_;
  std::shared_ptr<const BatchProgram> batch_;
};

}  // namespace rubato::formula
