// What only the gateway knows, sent as text: JSON with `type`. Each member of Messages is the newest of its type, without
// what the page does not read. Times in ms. What palpated tells is in contract.ts.

export type Vec3 = [number, number, number];
export type VoxelType = "uint8" | "int16" | "uint16" | "float32";

// A setting that a guest may steer, or that the page shows.
export interface SettingInfo {
  key: string;
  label: string;
  unit: string;
  help: string;
  kind: "number" | "flag" | "choice";
  minimum: number | null; // null: no bound
  maximum: number | null;
  whole: boolean; // only whole numbers
  words: string[]; // of a choice
}

// The values that a picture shows from black to white: level ± width / 2.
export interface ValueWindow { level: number; width: number }

// The last 20 changes by guests.
export interface SteeringMessage {
  changes: { user: string; key: string; value: number; time_ms: number }[];
}

export interface Messages {
  hello: { version: string; user: string; may_steer: string[]; may_stop: boolean; settings: SettingInfo[] };
  // The gateway's link to palpated. In a room of a NATS server: to NATS, to the room's publisher, and that one's to
  // palpated. `why` is "" if it is connected.
  connection: { state: "connecting" | "connected" | "lost"; why: string; palpated: string };
  // The gateway's own copy of the volume. `loading`: `problem` says how far palpated's first volume is.
  copy: { bricks_left: number; problem: string; loading: boolean };
  manifest: { name: string }; // of the blob
  steering: SteeringMessage;
  guests: { count: number };
}
export type Topic = keyof Messages;
export const kTopics: readonly Topic[] = [
  "hello", "connection", "copy", "manifest", "steering", "guests",
];
