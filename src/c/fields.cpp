// The members of the structs of truepose.h that are the core's, by name: one table for each.
#include "c/fields.hpp"

namespace truepose::c {
void describe(const Robot& robot, truepose_description& description) {
  std::memcpy(&description, &robot, sizeof description);
  const auto end = [](auto& parts, int used) {
    for (std::size_t k = std::size_t(used); k < std::size(parts); ++k) parts[k] = {};
  };
  end(description.chain, robot.chains);
  end(description.sensor, robot.r);
  end(description.body, robot.bodies);
  end(description.axis, passive_axes(robot.mobility));
  for (truepose_chain& chain : description.chain) chain.unused = 0;
}

bool finite(const void* of, const Table& table) {
  for (const Field& field : table.fields) {
    if (field.numbers != Numbers::real) continue;
    const Real* number = reinterpret_cast<const Real*>(static_cast<const char*>(of) + field.offset);
    if (!all_finite(number, field.count())) return false;
  }
  return true;
}
}  // namespace truepose::c
