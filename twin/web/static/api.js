/* The server's JSON. Addresses are relative, so that the page also works below a path. */

/** The server said no, in a sentence. */
export class Refused extends Error {
  constructor(status, sentence) {
    super(sentence);
    this.status = status;
  }
}

/** Nobody answered, or the server cannot for now: the network is lost, the server gone, the store locked. */
export class Unreachable extends Error {}

async function ask(path, options) {
  let response;
  try {
    response = await fetch(path, { credentials: "same-origin", cache: "no-store", signal: AbortSignal.timeout(15000), ...options });
  } catch (cause) {
    throw new Unreachable("", { cause });
  }
  let body = null;
  try {
    body = await response.json();
  } catch {
    // An answer cut off in the middle is as good as none: it may be asked again.
    if (response.ok) throw new Unreachable("");
  }
  if (response.ok) return body;
  // 500 is a fault of twin, which asking again would not mend.
  if (response.status > 500) throw new Unreachable(body?.error ?? "");
  throw new Refused(response.status, body?.error ?? `${response.status}`);
}

export function get(path, query = {}) {
  const set = Object.entries(query).filter(([, value]) => value !== "" && value !== null && value !== undefined);
  const text = new URLSearchParams(set).toString();
  return ask(text ? `${path}?${text}` : path, {});
}

/** The key makes a repeated request count once. */
export function post(path, body, key) {
  return ask(path, {
    method: "POST",
    headers: { "Content-Type": "application/json", ...(key ? { "Idempotency-Key": key } : {}) },
    body: JSON.stringify(body),
  });
}
