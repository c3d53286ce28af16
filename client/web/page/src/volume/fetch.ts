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
export const kMostTogether = 16;
let canTakeTogether = true;

// Fetches blobs that all have so many bytes.
export async function fetchEqual(names: readonly string[], bytesEach: number, signal: AbortSignal): Promise<ArrayBuffer[]> {
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

// Works on all items, several at a time, in their order. After an error no further item is begun.
export async function forEachAtATime<T>(items: readonly T[], work: (item: T) => Promise<void>): Promise<void> {
  let next = 0;
  const worker = async () => {
    while (next < items.length) {
      try {
        await work(items[next++]);
      } catch (error) {
        next = items.length;
        throw error;
      }
    }
  };
  await allDone(Array.from({ length: kAtATime }, worker));
}
