// Decodes base64 to bytes.

/** The bytes of a base64 text, as an ArrayBuffer. */
export function bytes(text) {
  if (Uint8Array["fromBase64"]) return Uint8Array["fromBase64"](text).buffer;
  const letters = atob(text);
  const out = new Uint8Array(letters.length);
  for (let k = 0; k < out.length; k += 1) out[k] = letters.charCodeAt(k);
  return out.buffer;
}
