// A text nobody uses, one with other placeholders, and one that stands twice.
export const bad = {
  nobody_uses: ["Nobody", "无人"],
  other_gaps: ["{n} modules", "{m} 个模块"],
};
export const again = {
  other_gaps: ["{n} modules", "{n} 个模块"],
};
export const used = ["other_gaps"];
