<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>AnswerTable</name>
    <message>
        <source>Parameters found</source>
        <translation>求得的参数</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>found</source>
        <translation>求得</translation>
    </message>
    <message>
        <source>least squares</source>
        <translation>最小二乘</translation>
    </message>
    <message>
        <source>difference</source>
        <translation>差值</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>以 σ 计</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>bench&apos;s truth</source>
        <translation>虚拟台真值</translation>
    </message>
    <message>
        <source>error in σ</source>
        <translation>误差/σ</translation>
    </message>
    <message>
        <source>Not determined by this recording</source>
        <translation>这段数据无法确定</translation>
    </message>
</context>
<context>
    <name>AnswerViews</name>
    <message>
        <source>How it is done</source>
        <translation>操作方法</translation>
    </message>
    <message>
        <source>Rests and motions</source>
        <translation>静止与运动</translation>
    </message>
    <message>
        <source>Before and after</source>
        <translation>前后对比</translation>
    </message>
    <message>
        <source>Convergence</source>
        <translation>收敛过程</translation>
    </message>
    <message>
        <source>Check and monitoring</source>
        <translation>检查与监视</translation>
    </message>
    <message>
        <source>Residuals</source>
        <translation>残差</translation>
    </message>
    <message>
        <source>Parameters</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Checks</source>
        <translation>检查</translation>
    </message>
    <message>
        <source>Live</source>
        <translation>实时</translation>
    </message>
    <message>
        <source>Solve a recording first</source>
        <translation>请先解算一段数据</translation>
    </message>
</context>
<context>
    <name>AppliedView</name>
    <message>
        <source>Apply to a recording…</source>
        <translation>应用于数据…</translation>
    </message>
    <message>
        <source>Apply to a recording</source>
        <translation>应用于数据</translation>
    </message>
    <message>
        <source>Take data from the unit, or choose any recording of it: rests are shown before and after.</source>
        <translation>接收产品的实时数据，或任选该产品的一段数据，显示其静止时标定前后的输出。</translation>
    </message>
    <message>
        <source>Applying the answer</source>
        <translation>正在应用结果</translation>
    </message>
    <message>
        <source>Receiving data from the unit</source>
        <translation>正在接收产品数据</translation>
    </message>
    <message>
        <source>Data are being received from the unit.</source>
        <translation>正在接收产品的数据。</translation>
    </message>
    <message>
        <source>Receives {0} s of data and shows them before and after; nothing moves, nothing is written</source>
        <translation>接收产品 {0} s 的实时数据，显示标定前后的对比；转台不动，也不写入任何内容</translation>
    </message>
    <message>
        <source>Unit {0}, {1:.0f} s of data, received at {2}</source>
        <translation>产品 {0}，实时数据 {1:.0f} s，接收于 {2}</translation>
    </message>
    <message>
        <source>| f | − g at rest, rms</source>
        <translation>静止时 | f | − g，均方根</translation>
    </message>
    <message>
        <source>as received</source>
        <translation>原样输出</translation>
    </message>
    <message>
        <source>From the unit now</source>
        <translation>接收产品实时数据</translation>
    </message>
    <message>
        <source>Before and after, over time</source>
        <translation>标定前后随时间的对比</translation>
    </message>
    <message>
        <source>rate at rest, rms</source>
        <translation>静止时角速度，均方根</translation>
    </message>
    <message>
        <source>| f | − g, µg</source>
        <translation>| f | − g，µg</translation>
    </message>
    <message>
        <source>- - earth rate {0:.1f}</source>
        <translation>- - 地球自转 {0:.1f}</translation>
    </message>
    <message>
        <source>Rate, °/h</source>
        <translation>角速度，°/h</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>shaded: rests, bold: their means; s from the start</source>
        <translation>阴影：静止段，粗线：其均值；横轴 s</translation>
    </message>
</context>
<context>
    <name>BenchBox</name>
    <message>
        <source>Makes a recording without hardware, together with its truth</source>
        <translation>无需硬件生成一段数据，真值存放在旁边</translation>
    </message>
    <message>
        <source>Virtual bench</source>
        <translation>虚拟台</translation>
    </message>
    <message>
        <source>MEMS grade</source>
        <translation>MEMS 级</translation>
    </message>
    <message>
        <source>tactical grade</source>
        <translation>战术级</translation>
    </message>
    <message>
        <source>navigation grade</source>
        <translation>导航级</translation>
    </message>
    <message>
        <source>unit</source>
        <translation>产品号</translation>
    </message>
    <message>
        <source>Another number draws another unit and other motions</source>
        <translation>换一个号就换一个产品和一组运动</translation>
    </message>
    <message>
        <source>Make one</source>
        <translation>生成数据</translation>
    </message>
</context>
<context>
    <name>GimbalView</name>
    <message>
        <source>Drift | D | in each turn, ″</source>
        <translation>每次转动的漂移 | D |，″</translation>
    </message>
    <message>
        <source>threshold</source>
        <translation>阈值</translation>
    </message>
    <message>
        <source>— predicted</source>
        <translation>— 预测</translation>
    </message>
    <message>
        <source>Axis {0}: below the threshold</source>
        <translation>{0} 轴：已小于阈值</translation>
    </message>
    <message>
        <source>Axis {0}: above the threshold</source>
        <translation>{0} 轴：未小于阈值</translation>
    </message>
    <message>
        <source>{0} turns by {1}°: {2} → {3}″, each leaves {4} %</source>
        <translation>转 {0} 次，每次 {1}°：{2} → {3}″，每次剩 {4} %</translation>
    </message>
    <message>
        <source>▼ gain α = {0}, fastest at {1}, stable below {2}</source>
        <translation>▼ 增益 α = {0}，最快 {1}，稳定上限 {2}</translation>
    </message>
    <message>
        <source>turn</source>
        <translation>次数</translation>
    </message>
</context>
<context>
    <name>MethodBar</name>
    <message>
        <source>Stages of the log</source>
        <translation>记录中的阶段</translation>
    </message>
    <message>
        <source>Solve the stages again as they were recorded</source>
        <translation>按记录重新解算各阶段</translation>
    </message>
</context>
<context>
    <name>MethodPanel</name>
    <message>
        <source>No recording was made</source>
        <translation>没有生成数据</translation>
    </message>
    <message>
        <source>This recording gives no answer</source>
        <translation>这段数据无法解算</translation>
    </message>
    <message>
        <source>The pair cannot be checked</source>
        <translation>无法检查</translation>
    </message>
    <message>
        <source>The answer cannot be applied</source>
        <translation>无法应用结果</translation>
    </message>
    <message>
        <source>Open a recording first, or make one</source>
        <translation>请先打开或生成一段数据</translation>
    </message>
    <message>
        <source>Solve a recording first</source>
        <translation>请先解算一段数据</translation>
    </message>
    <message>
        <source>Solve</source>
        <translation>解算</translation>
    </message>
    <message>
        <source>Guide me live</source>
        <translation>现场引导</translation>
    </message>
    <message>
        <source>Export result…</source>
        <translation>导出结果…</translation>
    </message>
    <message>
        <source>Making a recording</source>
        <translation>正在生成数据</translation>
    </message>
    <message>
        <source>Reading the recording</source>
        <translation>正在读取数据</translation>
    </message>
    <message>
        <source>Solving</source>
        <translation>正在解算</translation>
    </message>
    <message>
        <source>Replaying the recording</source>
        <translation>正在回放数据</translation>
    </message>
    <message>
        <source>Goes to the operator page, which guides from position to position</source>
        <translation>转到操作员页面，逐个位置引导</translation>
    </message>
    <message>
        <source>Drawing</source>
        <translation>正在绘图</translation>
    </message>
    <message>
        <source>Writing the result</source>
        <translation>正在写结果</translation>
    </message>
</context>
<context>
    <name>PairBars</name>
    <message>
        <source>IMU {0}</source>
        <translation>IMU {0}</translation>
    </message>
    <message>
        <source>primary</source>
        <translation>主 IMU</translation>
    </message>
    <message>
        <source>no rest to check at</source>
        <translation>没有静止段可检查</translation>
    </message>
    <message>
        <source>within</source>
        <translation>合格</translation>
    </message>
    <message>
        <source>out of tolerance</source>
        <translation>超差</translation>
    </message>
    <message>
        <source>calibrated: now {0}</source>
        <translation>已标定，现为 {0}</translation>
    </message>
    <message>
        <source>calibrated, still {0}</source>
        <translation>已标定，仍为 {0}</translation>
    </message>
    <message>
        <source>at most {0}</source>
        <translation>上限 {0}</translation>
    </message>
    <message>
        <source>IMU {0}, {1}: nothing is stored yet.</source>
        <translation>IMU {0}，{1}：尚未保存。</translation>
    </message>
    <message>
        <source>IMU {0}, {1}: last calibrated on {2}, {3} values in {4}</source>
        <translation>IMU {0}，{1}：上次标定 {2}，{3} 个值存于 {4}</translation>
    </message>
</context>
<context>
    <name>PairCheckView</name>
    <message>
        <source>Check at rest</source>
        <translation>静止检查</translation>
    </message>
    <message>
        <source>Check now</source>
        <translation>立即检查</translation>
    </message>
    <message>
        <source>Replays the recording: IMUs out of tolerance are calibrated, the results are stored</source>
        <translation>像实时一样回放数据：超差的 IMU 重新标定，结果保存</translation>
    </message>
    <message>
        <source>Check now replays this recording as if it were live: it checks at the first rest, and calibrates what is out of tolerance from the motion after it.</source>
        <translation>“立即检查”像实时一样回放这段数据：在第一个静止段检查，超差者用其后的运动标定。</translation>
    </message>
    <message>
        <source>Monitoring</source>
        <translation>监视</translation>
    </message>
    <message>
        <source>Stored</source>
        <translation>已保存</translation>
    </message>
    <message>
        <source>Abandoned: {0}</source>
        <translation>已放弃：{0}</translation>
    </message>
</context>
<context>
    <name>PairLiveView</name>
    <message>
        <source>Watch live</source>
        <translation>实时监测</translation>
    </message>
    <message>
        <source>Check now</source>
        <translation>立即检查</translation>
    </message>
    <message>
        <source>Checks at the next rest; IMUs out of tolerance are calibrated from the motion after it</source>
        <translation>在下一个静止段检查；超差的 IMU 用其后的运动标定</translation>
    </message>
    <message>
        <source>Follows the station&apos;s IMUs as they move: it checks at rest, calibrates what is out of tolerance from the motion after it, and stores the results. The program moves nothing.</source>
        <translation>跟随工位上各 IMU 的运动：静止时检查，超差者用其后的运动标定，并保存结果。程序不驱动任何设备。</translation>
    </message>
    <message>
        <source>Clocks</source>
        <translation>时钟</translation>
    </message>
    <message>
        <source>Stored</source>
        <translation>已保存</translation>
    </message>
    <message>
        <source>Check at rest</source>
        <translation>静止检查</translation>
    </message>
    <message>
        <source>Corrected data</source>
        <translation>修正后的数据</translation>
    </message>
    <message>
        <source>Stop</source>
        <translation>停止</translation>
    </message>
    <message>
        <source>Start a watch first</source>
        <translation>请先开始监测</translation>
    </message>
    <message>
        <source>primary</source>
        <translation>主 IMU</translation>
    </message>
    <message>
        <source>IMU {0}</source>
        <translation>IMU {0}</translation>
    </message>
    <message>
        <source>none</source>
        <translation>无</translation>
    </message>
    <message>
        <source>valid: {0}; switch-overs: {1}</source>
        <translation>有效：{0}；切换次数：{1}</translation>
    </message>
    <message>
        <source>| f | − g, µg</source>
        <translation>| f | − g，µg</translation>
    </message>
    <message>
        <source>Rate, °/h</source>
        <translation>角速度，°/h</translation>
    </message>
    <message>
        <source>s before now</source>
        <translation>距现在的秒数</translation>
    </message>
    <message>
        <source>This station has one IMU. Choose a station with [imu2], such as virtual_pair</source>
        <translation>该工位只有一个 IMU。请选择含 [imu2] 的工位，例如 virtual_pair</translation>
    </message>
    <message>
        <source>not watching</source>
        <translation>未监测</translation>
    </message>
    <message>
        <source>opening the ports</source>
        <translation>正在打开端口</translation>
    </message>
    <message>
        <source>the primary sends no samples</source>
        <translation>主 IMU 无输出</translation>
    </message>
    <message>
        <source>primary out of tolerance: {0}</source>
        <translation>主 IMU 超差：{0}</translation>
    </message>
    <message>
        <source>watching; no check is due</source>
        <translation>监测中；暂无检查</translation>
    </message>
    <message>
        <source>IMU {0}: {1:.3f} s from arrival times; measured with the first motion</source>
        <translation>IMU {0}：按到达时间为 {1:.3f} s；首次运动时测定</translation>
    </message>
    <message>
        <source>IMU {0}: offset {1:.6f} s ± {2:.1f} µs, drift {3:.2f} ppm</source>
        <translation>IMU {0}：偏差 {1:.6f} s ± {2:.1f} µs，漂移 {3:.2f} ppm</translation>
    </message>
</context>
<context>
    <name>PairResidualsView</name>
    <message>
        <source>Secondary shown</source>
        <translation>所示从 IMU</translation>
    </message>
    <message>
        <source>Nothing was calibrated in this recording</source>
        <translation>这段数据中没有标定</translation>
    </message>
    <message>
        <source>IMU {0} gyro against the primary, °/s</source>
        <translation>IMU {0} 陀螺与主 IMU 之差，°/s</translation>
    </message>
    <message>
        <source>IMU {0} accelerometer against the primary, m/s²</source>
        <translation>IMU {0} 加表与主 IMU 之差，m/s²</translation>
    </message>
    <message>
        <source>gyro residual, rms</source>
        <translation>陀螺残差，均方根</translation>
    </message>
    <message>
        <source>accelerometer residual, rms</source>
        <translation>加表残差，均方根</translation>
    </message>
    <message>
        <source>clock offset</source>
        <translation>时钟偏差</translation>
    </message>
    <message>
        <source>lever arm x, y, z</source>
        <translation>杆臂 x、y、z</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>s from the start</source>
        <translation>横轴 s</translation>
    </message>
</context>
<context>
    <name>PositionsView</name>
    <message>
        <source>Directions of gravity in the unit&apos;s axes</source>
        <translation>重力在产品轴系中的方向</translation>
    </message>
    <message>
        <source>Direction of gravity in the unit at {0} rests. Drag to rotate.</source>
        <translation>{0} 个静止段中重力在产品里的方向。拖动可旋转。</translation>
    </message>
    <message>
        <source>| f | − g at rest, rms</source>
        <translation>静止时 | f | − g，均方根</translation>
    </message>
    <message>
        <source>angle of motions, rms</source>
        <translation>运动角度误差，均方根</translation>
    </message>
    <message>
        <source>| f | − g at each rest, µg</source>
        <translation>各静止段 | f | − g，µg</translation>
    </message>
    <message>
        <source>Error of each motion&apos;s angle, ″</source>
        <translation>各段运动的角度误差，″</translation>
    </message>
    <message>
        <source>before</source>
        <translation>标定前</translation>
    </message>
    <message>
        <source>after</source>
        <translation>标定后</translation>
    </message>
    <message>
        <source>limit</source>
        <translation>限差</translation>
    </message>
</context>
<context>
    <name>_AnswerHead</name>
    <message>
        <source>{0} at {1:g} Hz</source>
        <translation>{0}，{1:g} Hz</translation>
    </message>
    <message>
        <source>not determined: {0} of {1}</source>
        <translation>无法确定：{1} 个中的 {0} 个</translation>
    </message>
    <message>
        <source>{0} of {1} checks failed</source>
        <translation>{1} 项检查中 {0} 项不合格</translation>
    </message>
    <message>
        <source>Solved; the recording names no limits</source>
        <translation>已解算；数据未给出限差</translation>
    </message>
    <message>
        <source>Passed, {0} near-misses</source>
        <translation>合格，{0} 项临界</translation>
    </message>
    <message>
        <source>Inside every limit</source>
        <translation>全部在限差内</translation>
    </message>
</context>
</TS>
