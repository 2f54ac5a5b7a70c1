// Bytes of base64, without a call for each of them.

/** An ArrayBuffer of what the text says. */
export function bytes(text) {
  if (Uint8Array["fromBase64"]) return Uint8Array["fromBase64"](text).buffer;
  const letters = atob(text);
  const out = new Uint8Array(letters.length);
  for (let k = 0; k < out.length; k += 1) out[k] = letters.charCodeAt(k);
  return out.buffer;
}
