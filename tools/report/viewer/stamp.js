// Writes into the bundle from which source it was made; a test compares.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";

const stamp = createHash("sha256").update(readFileSync("viewer.js")).digest("hex");
const bundle = readFileSync("viewer.min.js", "utf8").replaceAll("</script", "<\\/script");
writeFileSync("viewer.min.js", `// viewer.js ${stamp}, with three.js (MIT)\n${bundle}`);
