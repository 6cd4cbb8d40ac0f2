// Are the documents right about the tree? Relative links and their anchors, `make` targets in code,
// and no download addresses in the lock file of the console. Commands of `footfall` that the
// documents show are checked by a test of the server.
import { existsSync, readFileSync, readdirSync, statSync } from "node:fs";
import { dirname, join, normalize, relative } from "node:path";

const problems = [];

function documents(folder) {
  const found = [];
  for (const entry of readdirSync(folder, { withFileTypes: true })) {
    if (/^(target|node_modules|dist|logs|\.git|\.venv)$/.test(entry.name)) continue;
    const path = join(folder, entry.name);
    if (entry.isDirectory()) found.push(...documents(path));
    else if (entry.name.endsWith(".md")) found.push(path);
  }
  return found;
}

/** Anchors of headings, as the usual hosts make them. */
function anchors(path) {
  const seen = new Map();
  const found = new Set();
  let fenced = false;
  for (const line of readFileSync(path, "utf8").split("\n")) {
    if (/^\s*(```|~~~)/.test(line)) fenced = !fenced;
    const heading = fenced ? null : /^#{1,6}\s+(.*?)\s*#*$/.exec(line);
    if (!heading) continue;
    const text = heading[1].replace(/`|\*|\[([^\]]*)\]\([^)]*\)/g, "$1").toLowerCase();
    const anchor = text.replace(/[^\p{L}\p{N}\s_-]/gu, "").replace(/\s/g, "-");
    const n = seen.get(anchor) ?? 0;
    seen.set(anchor, n + 1);
    found.add(n === 0 ? anchor : `${anchor}-${n}`);
  }
  return found;
}

const targets = new Set(
  [...readFileSync("Makefile", "utf8").matchAll(/^([a-z][a-z-]*):(?!=)/gm)].map((m) => m[1]),
);

for (const path of documents(".")) {
  const text = readFileSync(path, "utf8");
  const prose = text.replace(/^\s*(```|~~~)[\s\S]*?^\s*\1/gm, "").replace(/`[^`\n]*`/g, "");
  for (const match of prose.matchAll(/\[[^\]]*\]\(\s*<?([^)>\s]+)>?(?:\s+"[^"]*")?\s*\)/g)) {
    const link = match[1];
    if (/^[a-z][a-z0-9+.-]*:/i.test(link)) continue;
    const [file, anchor] = decodeURIComponent(link).split("#");
    const target = file === "" ? path : normalize(join(dirname(path), file));
    if (relative(".", target).startsWith("..")) {
      problems.push(`${path}: the link ${link} leaves the project`);
    } else if (!existsSync(target)) {
      problems.push(`${path}: the link ${link} leads nowhere`);
    } else if (anchor && statSync(target).isFile() && target.endsWith(".md")) {
      if (!anchors(target).has(anchor)) problems.push(`${path}: there is no heading for ${link}`);
    }
  }
  for (const match of text.matchAll(/(?:^|`)(?:\$ )?make ([a-z][a-z -]*?)(?=`|$|\s#)/gm)) {
    for (const target of match[1].trim().split(/\s+/)) {
      if (!targets.has(target)) problems.push(`${path}: there is no "make ${target}"`);
    }
  }
}

if (/"resolved"\s*:/.test(readFileSync("web/package-lock.json", "utf8"))) {
  problems.push("web/package-lock.json: holds download addresses; see web/.npmrc");
}

for (const problem of problems) console.error(problem);
if (problems.length > 0) process.exit(1);
