// Fetches blobs of the volume by name. A blob never changes, so the browser's cache keeps it.

// The gateway no longer keeps the blob: a newer manifest replaced its own.
export class Gone extends Error {}

function check(response: Response): Response {
  if (response.status === 410) throw new Gone("superseded");
  if (!response.ok) throw new Error(`the gateway answers ${response.status}`);
  return response;
}

export async function fetchBlob(name: string, signal: AbortSignal): Promise<Response> {
  return check(await fetch(`volume/${name}`, { signal }));
}

// Blobs in one request: each costs a browser milliseconds.
const kMostTogether = 16;
let canTakeTogether = true;

async function fetchTogether(names: string[], bytesEach: number, signal: AbortSignal): Promise<ArrayBuffer[]> {
  if (canTakeTogether && names.length > 1) {
    const response = await fetch(`volume/${names.join()}`, { signal });
    const bytes = response.status === 406 ? null : await check(response).arrayBuffer();
    if (bytes?.byteLength === names.length * bytesEach) {
      return names.map((_, n) => bytes.slice(n * bytesEach, (n + 1) * bytesEach));
    }
    canTakeTogether = false; // a browser without zstd, or one that stops after the first blob
  }
  return Promise.all(names.map(async (name) => (await fetchBlob(name, signal)).arrayBuffer()));
}

// Waits for all, and then throws the first error if there is one.
export async function allDone(parts: Promise<void>[]): Promise<void> {
  await Promise.allSettled(parts);
  await Promise.all(parts);
}

// More at a time gain nothing: a browser opens six connections to a host.
const kAtATime = 8;

// Fetches blobs that all have so many bytes, in their order, and has them taken as they come. After an error no
// further one is fetched.
export async function fetchEqual(
  names: string[],
  bytesEach: number,
  signal: AbortSignal,
  take: (names: string[], blobs: ArrayBuffer[]) => void,
): Promise<void> {
  let next = 0;
  const worker = async () => {
    while (next < names.length) {
      const some = names.slice(next, next + kMostTogether);
      next += some.length;
      try {
        take(some, await fetchTogether(some, bytesEach, signal));
      } catch (error) {
        next = names.length;
        throw error;
      }
    }
  };
  await allDone(Array.from({ length: kAtATime }, worker));
}
