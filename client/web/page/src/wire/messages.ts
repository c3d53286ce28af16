// What the gateway sends as text: JSON with `type`. Each member of Messages is the newest of its type, without what
// the page does not read. Lengths in mm of the device's frame D, values in data units, times in ms.

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
  words: string[]; // of a choice
}

// The values that a picture shows from black to white: level ± width / 2.
export interface ValueWindow { level: number; width: number }

export interface SuggestedIsovalue { name: string; isovalue: number; reason: string }

// `name` and what follows are absent while there is no volume.
export interface VolumeMessage {
  loading?: string;
  name?: string;
  size?: Vec3;
  voxel_type?: VoxelType;
  value_min?: number;
  value_max?: number;
  unit?: string;
  window?: ValueWindow; // that the file proposes for pictures
  world_from_index?: number[]; // rows of the 3×4 map from voxel indices
  histogram?: { low: number; high: number; counts: number[] };
  suggested?: SuggestedIsovalue[];
}

// `device_from_index`: rows of the 3×4 map from voxel indices to D. `patient_axes`: where +x, +y and +z of the
// world point in the patient, such as "LPS"; "": unknown. They are answered by a person, or stated by the file.
export interface PlacementMessage {
  device_from_index: number[];
  patient_axes: string;
  patient_axes_answered: boolean;
}

// The last 20 changes by guests.
export interface SteeringMessage {
  changes: { user: string; key: string; value: number; time_ms: number }[];
}

export interface Messages {
  hello: { version: string; user: string; may_steer: string[]; settings: SettingInfo[] };
  // The gateway's link to palpated. In a room of a NATS server: to NATS, to the room's publisher, and that one's to
  // palpated. `why` is "" if it is connected.
  connection: { state: "connecting" | "connected" | "lost"; why: string; palpated: string };
  volume: VolumeMessage;
  placement: PlacementMessage;
  copy: { bricks_left: number; problem: string }; // the gateway's own copy of the volume
  manifest: { name: string }; // of the blob
  settings: { revision: number; values: Record<string, number | boolean | string> };
  steering: SteeringMessage;
  series: { frames: number; position_frames: number; playing: boolean; rate_hz: number }; // `frames` 0: no series
  recording: { running: boolean; seconds: number; lost_ticks: number };
  guests: { count: number };
}
export type Topic = keyof Messages;
export const kTopics: readonly Topic[] = [
  "hello", "connection", "volume", "placement", "copy", "manifest",
  "settings", "steering", "series", "recording", "guests",
];
