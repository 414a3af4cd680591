// The command line that makes the picture again, and copying texts.

import { toText } from "./camera.js";

const quote = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`);

// The words of `pcsg render` for what is wanted; `file` as `pcsg view` was given it.
export function commandOf(file, wanted, size) {
  const words = ["pcsg", "render", quote(file)];
  for (const [name, value] of Object.entries(wanted.values)) {
    if (name === "TIME") words.push("--time", String(value));
    else words.push("-D", quote(`${name}=${value}`));
  }
  if (wanted.camera) words.push("--camera", `"${toText(wanted.camera)}"`);
  if (wanted.mode) words.push("--mode", wanted.mode);
  words.push("--size", size.join("x"), "--samples", String(wanted.samples));
  return words.join(" ");
}

// The setting that a grammar has for a camera.
export function settingOf(camera) {
  return `camera { ${toText(camera).replace(/(\w+)=(\S+)/g, (_, key, value) =>
    value.includes(",") ? `${key} = (${value.replaceAll(",", ", ")});` : `${key} = ${value};`)} }`;
}

export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false; // no permission, or no secure connection
  }
}
