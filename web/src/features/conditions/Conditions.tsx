// What telemetry must show before a command goes: one line each, with the present value beside it.

import { Plus, X } from "lucide-react";
import { useId, useState } from "react";

import type { Precondition } from "../../api/types";
import {
  type Comparison,
  COMPARISONS,
  fieldOf,
  fieldsOf,
  holds,
  preconditionWords,
  scalarOf,
  shownValue,
} from "../../lib/fields";
import { useLive } from "../../store/console";
import { StatusMark } from "../../ui/StatusMark";
import "./conditions.css";

export type Channel = "rover/state" | "rover/stability";

const CHANNEL_WORDS: Record<Channel, string> = {
  "rover/state": "state",
  "rover/stability": "stability",
};

/** Most of one command, as the server takes them. */
const MOST = 20;

interface Props {
  /** Prefix of the test ids. */
  name: string;
  value: Precondition[];
  set: (value: Precondition[]) => void;
  /** Steps are asked on board, where only the rover's own state is known. */
  channels: Channel[];
}

export function Conditions({ name, value, set, channels }: Props) {
  return (
    <div className="stack conditions">
      {value.length > 0 && (
        <ul className="stack" data-testid={`${name}-conditions`}>
          {value.map((condition, i) => (
            <li key={`${i} ${preconditionWords(condition)}`} className="condition">
              <Mark condition={condition} />
              <span className="small condition-words">
                {preconditionWords(condition)}
                <span className="quiet"> within {condition.max_age_s} s, now </span>
                <Present condition={condition} />
              </span>
              <button
                type="button"
                className="button bare icon"
                aria-label={`Remove: ${preconditionWords(condition)}`}
                title="Remove"
                onClick={() => set(value.filter((_, k) => k !== i))}
              >
                <X size={14} aria-hidden />
              </button>
            </li>
          ))}
        </ul>
      )}
      {value.length < MOST && (
        <NewCondition name={name} channels={channels} add={(c) => set([...value, c])} />
      )}
    </div>
  );
}

/** The last message of a channel. */
function useMessage(channel: string): unknown {
  return useLive((c) => (channel === "rover/stability" ? c.stability?.message : c.rover?.message));
}

function Present({ condition }: { condition: Precondition }) {
  const found = fieldOf(useMessage(condition.channel), condition.field);
  return <span className="num of-rover">{shownValue(found)}</span>;
}

function Mark({ condition }: { condition: Precondition }) {
  const found = fieldOf(useMessage(condition.channel), condition.field);
  const good = holds(found, condition.op, condition.value);
  const words = good === null ? "does not compare" : good ? "holds now" : "does not hold now";
  return <StatusMark status={good === null ? "off" : good ? "normal" : "serious"} label={words} />;
}

function NewCondition(props: {
  name: string;
  channels: Channel[];
  add: (condition: Precondition) => void;
}) {
  const { name, channels, add } = props;
  const [channel, setChannel] = useState<Channel>(channels[0]!);
  const [field, setField] = useState("");
  const [op, setOp] = useState<Comparison>("eq");
  const [text, setText] = useState("");
  const [age, setAge] = useState("10");
  const list = useId();
  const message = useMessage(channel);
  const found = fieldOf(message, field.trim());
  const value = scalarOf(text);
  const max_age_s = Number(age);
  const goodAge = age !== "" && max_age_s >= 0 && max_age_s <= 86_400;
  const known = ["number", "string", "boolean"].includes(typeof found);
  const compares = value !== null && holds(found, op, value) !== null;
  const good = known && compares && goodAge;
  const why = !known
    ? "Name a field that telemetry has"
    : !compares
      ? "Give a value that compares with the present one"
      : undefined;
  return (
    <form
      className="condition-new"
      onSubmit={(event) => {
        event.preventDefault();
        if (!good) return;
        add({ channel, field: field.trim(), op, value, max_age_s });
        setField("");
        setText("");
      }}
    >
      {channels.length > 1 && (
        <label className="field">
          of
          <select
            data-testid={`${name}-channel`}
            value={channel}
            onChange={(event) => setChannel(event.target.value as Channel)}
          >
            {channels.map((c) => (
              <option key={c} value={c}>
                {CHANNEL_WORDS[c]}
              </option>
            ))}
          </select>
        </label>
      )}
      <label className={channels.length > 1 ? "field" : "field condition-wide"}>
        field
        <input
          type="text"
          list={list}
          spellCheck={false}
          autoComplete="off"
          placeholder="operation.mode"
          data-testid={`${name}-field`}
          aria-invalid={field !== "" && !known}
          value={field}
          onChange={(event) => setField(event.target.value)}
        />
        <Fields key={channel} id={list} message={message} />
      </label>
      <label className="field">
        is to be
        <select
          data-testid={`${name}-op`}
          value={op}
          onChange={(event) => setOp(event.target.value as Comparison)}
        >
          {COMPARISONS.map(([value, words]) => (
            <option key={value} value={value}>
              {words}
            </option>
          ))}
        </select>
      </label>
      <label className="field">
        value
        <input
          type="text"
          spellCheck={false}
          autoComplete="off"
          data-testid={`${name}-value`}
          aria-invalid={text !== "" && known && !compares}
          value={text}
          onChange={(event) => setText(event.target.value)}
        />
      </label>
      <label className="field">
        max age (s)
        <input
          type="number"
          min={0}
          max={86400}
          className="num"
          data-testid={`${name}-age`}
          aria-invalid={!goodAge}
          value={age}
          onChange={(event) => setAge(event.target.value)}
        />
      </label>
      <div className="row between condition-low">
        <span className="small quiet" data-testid={`${name}-present`}>
          {field.trim() === "" ? "" : known ? `now ${shownValue(found)}` : "no such field"}
        </span>
        <button
          type="submit"
          className="button"
          data-testid={`${name}-add`}
          disabled={!good}
          title={why}
        >
          <Plus size={14} aria-hidden />
          Add
        </button>
      </div>
    </form>
  );
}

/** The fields that telemetry has, read once: their names do not change from frame to frame. */
function Fields({ id, message }: { id: string; message: unknown }) {
  const [fields] = useState(() => fieldsOf(message));
  return (
    <datalist id={id}>
      {fields.map((field) => (
        <option key={field} value={field} />
      ))}
    </datalist>
  );
}
