// What the gateway sends as text: JSON with `type`. Each member of Messages is the newest of its
// type. Lengths in mm of the device's frame D, values in data units, times in ms.

import type { Vec3, VoxelType } from "../render/types";

export type { Vec3, VoxelType };

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

export interface HelloMessage {
  type: "hello";
  protocol: number;
  version: string;
  user: string;
  may_steer: string[];
  settings: SettingInfo[];
  server_time_ms: number;
}

// The gateway's link to palpated. In a room of a NATS server: to NATS, to the room's publisher, and that one's
// to palpated.
export interface ConnectionMessage {
  type: "connection";
  state: "connecting" | "connected" | "lost";
  why: string; // "": connected
  palpated: string;
  since_ms: number; // the gateway's clock
}

export interface SuggestedIsovalue { name: string; isovalue: number; reason: string }

// `name` and what follows are absent while there is no volume.
export interface VolumeMessage {
  type: "volume";
  loading?: string;
  name?: string;
  size?: Vec3;
  voxel_type?: VoxelType;
  value_min?: number;
  value_max?: number;
  background?: number;
  unit?: string;
  world_from_index?: number[]; // rows of the 3×4 map from voxel indices
  histogram?: { low: number; high: number; counts: number[] };
  suggested?: SuggestedIsovalue[];
}

// `device_from_index`: rows of the 3×4 map from voxel indices to D. `patient_axes`: where +x, +y and +z of the
// world point in the patient, such as "LPS"; "": unknown. They are answered by a person, or stated by the file.
export interface PlacementMessage {
  type: "placement";
  device_from_index: number[];
  settings_revision: number;
  patient_axes: string;
  patient_axes_answered: boolean;
}

// The gateway's own copy of the volume.
export interface CopyMessage { type: "copy"; bricks_left: number; problem: string }

// `name`: of the blob.
export interface ManifestMessage { type: "manifest"; name: string; revision: number; complete: boolean }

export interface SettingsMessage {
  type: "settings";
  revision: number;
  values: Record<string, number | boolean | string>;
}

// The last 20 changes by guests.
export interface SteeringMessage {
  type: "steering";
  changes: { user: string; key: string; value: number; time_ms: number }[];
}

// `frames` 0: no series.
export interface SeriesMessage {
  type: "series";
  frames: number;
  position_frames: number;
  playing: boolean;
  rate_hz: number;
}

export interface RecordingMessage { type: "recording"; running: boolean; seconds: number; lost_ticks: number }

export interface GuestsMessage { type: "guests"; count: number }

export interface Messages {
  hello: HelloMessage;
  connection: ConnectionMessage;
  volume: VolumeMessage;
  placement: PlacementMessage;
  copy: CopyMessage;
  manifest: ManifestMessage;
  settings: SettingsMessage;
  steering: SteeringMessage;
  series: SeriesMessage;
  recording: RecordingMessage;
  guests: GuestsMessage;
}
export type Topic = keyof Messages;
export const kTopics: readonly Topic[] = [
  "hello", "connection", "volume", "placement", "copy", "manifest",
  "settings", "steering", "series", "recording", "guests",
];
